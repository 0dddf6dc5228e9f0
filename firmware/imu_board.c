/* SPDX-License-Identifier: Apache-2.0 */
#include "imu_board.h"

#include <string.h>

#define INFORM_EVERY 1000000u /* µs */

static const lsm9ds1_settings AT_POWER_ON = {
    .gyroscope_dps = 245,
    .accelerometer_g = 2,
    .magnetometer_gauss = 4,
    .rate_mhz = 238000,
    .magnetometer_rate_mhz = 80000,
    .magnetometer_temperature_compensation = false,
};

static void inform(imu_board *board, uint32_t now) {
  imu_information frame = {
      .version = IMU_PROTOCOL_VERSION,
      .tick = now,
      .samples = board->samples,
      .tick_rate = 1000000,
      .command_errors = board->reader.errors,
      .supply_mv = board->supply_mv,
  };
  uint8_t bytes[IMU_MAXIMUM_FRAME];
  lsm9ds1_settings held = board->settings;
  if (lsm9ds1_dump(&board->bus, frame.registers) &&
      lsm9ds1_who_am_i(&board->bus, frame.who_am_i)) {
    lsm9ds1_settings_of(frame.registers, &held);
    if (held.gyroscope_dps != board->settings.gyroscope_dps ||
        held.accelerometer_g != board->settings.accelerometer_g ||
        held.magnetometer_gauss != board->settings.magnetometer_gauss ||
        held.rate_mhz != board->settings.rate_mhz) {
      board->settings = held; /* the sensor changed by itself, e.g. it lost its supply */
      board->configuration = (board->configuration + 1) & 3;
    }
  } else {
    board->i2c_errors++;
  }
  frame.flags = (uint8_t)((board->streaming ? IMU_STREAMING : 0) |
                          board->configuration << IMU_CONFIGURATION_SHIFT);
  frame.gyroscope_dps = held.gyroscope_dps;
  frame.accelerometer_g = held.accelerometer_g;
  frame.magnetometer_gauss = held.magnetometer_gauss;
  frame.rate_mhz = held.rate_mhz;
  frame.magnetometer_rate_mhz = held.magnetometer_rate_mhz;
  frame.i2c_errors = board->i2c_errors;
  frame.overruns = board->overruns;
  strncpy(frame.serial_number, board->serial_number, sizeof frame.serial_number - 1);
  memcpy(frame.firmware, board->firmware, sizeof frame.firmware);
  (void)board->send(board->context, bytes,
                    imu_encode_information(board->encoding, &frame, bytes));
  board->informed_at = now;
}

void imu_board_start(imu_board *board, uint32_t now) {
  board->settings = AT_POWER_ON;
  board->reader.encoding = board->encoding;
  board->sensor_ready = lsm9ds1_set_up(&board->bus, &board->settings);
  board->i2c_errors += !board->sensor_ready;
  inform(board, now);
}

void imu_board_sample(imu_board *board, uint32_t tick) {
  imu_data frame = {.tick = tick};
  bool magnetometer_new, temperature_new;
  uint8_t bytes[IMU_MAXIMUM_FRAME];
  if (!board->streaming) {
    return;
  }
  if (!lsm9ds1_read(&board->bus, &frame.temperature, &temperature_new, frame.counts,
                    &magnetometer_new)) {
    board->i2c_errors++;
    board->samples++; /* it was measured, and is lost */
    return;
  }
  if (magnetometer_new) {
    memcpy(board->magnetic, &frame.counts[6], sizeof board->magnetic);
  } else {
    memcpy(&frame.counts[6], board->magnetic, sizeof board->magnetic);
  }
  frame.sequence = (uint16_t)board->samples++;
  frame.flags = (uint8_t)((magnetometer_new ? IMU_MAGNETOMETER_NEW : 0) |
                          (temperature_new ? IMU_TEMPERATURE_NEW : 0) |
                          board->configuration << IMU_CONFIGURATION_SHIFT);
  if (!board->send(board->context, bytes, imu_encode_data(board->encoding, &frame, bytes))) {
    board->overruns++;
  }
}

/* Returns the status and puts the value now in force into `value`. */
static uint8_t obey(imu_board *board, uint8_t command, uint32_t *value) {
  lsm9ds1_settings wanted = board->settings;
  uint32_t asked = *value, in_force;
  uint8_t unused[LSM9DS1_REGISTERS];
  *value = 0;
  switch (command) {
    case IMU_INFORMATION:
      return IMU_DONE;
    case IMU_START:
      board->streaming = true;
      return IMU_DONE;
    case IMU_STOP:
      board->streaming = false;
      return IMU_DONE;
    case IMU_GYROSCOPE_FULL_SCALE:
      in_force = wanted.gyroscope_dps;
      wanted.gyroscope_dps = (uint16_t)(asked > 0xFFFF ? 0 : asked);
      break;
    case IMU_ACCELEROMETER_FULL_SCALE:
      in_force = wanted.accelerometer_g;
      wanted.accelerometer_g = (uint8_t)(asked > 0xFF ? 0 : asked);
      break;
    case IMU_MAGNETOMETER_FULL_SCALE:
      in_force = wanted.magnetometer_gauss;
      wanted.magnetometer_gauss = (uint8_t)(asked > 0xFF ? 0 : asked);
      break;
    case IMU_OUTPUT_DATA_RATE:
      in_force = wanted.rate_mhz;
      wanted.rate_mhz = asked;
      break;
    default:
      return IMU_UNKNOWN_COMMAND;
  }
  *value = in_force;
  if (asked == in_force) {
    return IMU_DONE;
  }
  if (!lsm9ds1_register_values(&wanted, unused)) {
    return IMU_BAD_VALUE;
  }
  if (!lsm9ds1_change(&board->bus, &wanted)) {
    board->i2c_errors++;
    return IMU_DEVICE_ERROR;
  }
  board->settings = wanted;
  board->configuration = (board->configuration + 1) & 3;
  *value = asked;
  return IMU_DONE;
}

void imu_board_receive(imu_board *board, uint8_t byte, uint32_t now) {
  imu_command command;
  if (!imu_read_command(&board->reader, byte, &command)) {
    return;
  }
  uint32_t value = command.value;
  uint8_t status = obey(board, command.command, &value);
  if (command.number != 0) {
    imu_acknowledgement answer = {command.command, command.number, status, value};
    uint8_t bytes[IMU_MAXIMUM_FRAME];
    (void)board->send(board->context, bytes,
                      imu_encode_acknowledgement(board->encoding, &answer, bytes));
  }
  inform(board, now);
}

void imu_board_poll(imu_board *board, uint32_t now) {
  if (now - board->informed_at >= INFORM_EVERY) {
    if (!board->sensor_ready) {
      board->sensor_ready = lsm9ds1_set_up(&board->bus, &board->settings);
    }
    inform(board, now);
  }
}
