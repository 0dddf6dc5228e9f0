/* SPDX-License-Identifier: Apache-2.0 */
/* The board's conversation with the host: samples out, commands in (doc/wire_protocol.md, 6). */
#ifndef IMU_BOARD_H
#define IMU_BOARD_H

#include "imu_frames.h"
#include "lsm9ds1.h"

typedef struct {
  lsm9ds1_bus bus;
  /* Takes a whole frame into the output buffer, or nothing of it and returns false. */
  bool (*send)(void *context, const uint8_t *bytes, size_t length);
  void *context;
  imu_encoding encoding;
  const char *serial_number; /* at most 16 characters, e.g. from the chip's unique number */
  uint8_t firmware[3];

  /* Below: the board's own, zero at power-on. */
  lsm9ds1_settings settings;
  imu_command_reader reader;
  uint8_t configuration;
  bool streaming;
  bool sensor_ready;
  uint32_t samples;
  uint32_t i2c_errors;
  uint32_t overruns;
  uint32_t informed_at;
  int16_t magnetic[3];
  uint16_t supply_mv;
} imu_board;

/* Sets up the sensor and says who it is; `now` is the microsecond counter. */
void imu_board_start(imu_board *board, uint32_t now);
/* On data ready: `tick` is the counter in the interrupt. */
void imu_board_sample(imu_board *board, uint32_t tick);
/* For every byte from the host. */
void imu_board_receive(imu_board *board, uint8_t byte, uint32_t now);
/* In the main loop: information once a second. */
void imu_board_poll(imu_board *board, uint32_t now);

#endif
