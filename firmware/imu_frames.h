/* SPDX-License-Identifier: Apache-2.0 */
/* Frames of the IMU wire protocol, version 1 (doc/wire_protocol.md): the board's end.
 * C99, no heap, no stdio, no assumption about byte order or alignment. */
#ifndef IMU_FRAMES_H
#define IMU_FRAMES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define IMU_PROTOCOL_VERSION 1u
#define IMU_REGISTERS 16u
#define IMU_MAXIMUM_FRAME 256u /* encoded, delimiter or line end included */

enum { IMU_MAGNETOMETER_NEW = 1, IMU_TEMPERATURE_NEW = 2, IMU_CONFIGURATION_SHIFT = 2 };
enum { IMU_STREAMING = 1 };
enum {
  IMU_INFORMATION = 1,
  IMU_START,
  IMU_STOP,
  IMU_GYROSCOPE_FULL_SCALE,
  IMU_ACCELEROMETER_FULL_SCALE,
  IMU_MAGNETOMETER_FULL_SCALE,
  IMU_OUTPUT_DATA_RATE
};
enum { IMU_DONE = 0, IMU_UNKNOWN_COMMAND, IMU_BAD_VALUE, IMU_DEVICE_ERROR };

typedef enum { IMU_BINARY, IMU_ASCII } imu_encoding;

typedef struct {
  uint16_t sequence;
  uint32_t tick;
  uint8_t flags;
  int16_t temperature;
  int16_t counts[9]; /* gyroscope, accelerometer, magnetometer: x y z each */
} imu_data;

typedef struct {
  uint8_t version;
  uint8_t flags;
  uint32_t tick;
  uint32_t samples;
  char serial_number[17]; /* up to 16 characters and the final zero */
  uint8_t firmware[3];
  uint32_t tick_rate;
  uint16_t gyroscope_dps;
  uint8_t accelerometer_g;
  uint8_t magnetometer_gauss;
  uint32_t rate_mhz;
  uint32_t magnetometer_rate_mhz;
  uint32_t i2c_errors;
  uint32_t overruns;
  uint32_t command_errors;
  uint16_t supply_mv;
  uint8_t who_am_i[2];
  uint8_t registers[IMU_REGISTERS];
} imu_information;

typedef struct {
  uint8_t command;
  uint8_t number;
  uint32_t value;
} imu_command;

typedef struct {
  uint8_t command;
  uint8_t number;
  uint8_t status;
  uint32_t value;
} imu_acknowledgement;

/* Each writes one frame into `out` (IMU_MAXIMUM_FRAME bytes) and returns its length. */
size_t imu_encode_data(imu_encoding encoding, const imu_data *frame, uint8_t *out);
size_t imu_encode_information(imu_encoding encoding, const imu_information *frame, uint8_t *out);
size_t imu_encode_acknowledgement(imu_encoding encoding, const imu_acknowledgement *frame,
                                  uint8_t *out);

/* Collects the bytes of the host. Zero-initialise, set `encoding`, feed byte by byte. */
typedef struct {
  imu_encoding encoding;
  uint32_t errors; /* frames that failed their check */
  size_t length;
  bool overlong;
  uint8_t bytes[IMU_MAXIMUM_FRAME];
} imu_command_reader;

/* Returns true when `byte` completes a command, which is then in `command`. */
bool imu_read_command(imu_command_reader *reader, uint8_t byte, imu_command *command);

/* The parts, for those who write their own. */
uint16_t imu_crc16(const uint8_t *data, size_t length); /* CRC-16/CCITT-FALSE */
size_t imu_cobs_encode(const uint8_t *data, size_t length, uint8_t *out);
/* Returns the decoded length, or SIZE_MAX where the bytes are no COBS. May work in place. */
size_t imu_cobs_decode(const uint8_t *data, size_t length, uint8_t *out);

#endif
