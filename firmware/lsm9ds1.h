/* SPDX-License-Identifier: Apache-2.0 */
/* Setting up and reading an LSM9DS1 over I2C (ST datasheet DocID025715 Rev 3). */
#ifndef LSM9DS1_H
#define LSM9DS1_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define LSM9DS1_REGISTERS 16u

/* The bus, yours: both return true on success. `address` has 7 bits. */
typedef struct {
  bool (*read)(void *context, uint8_t address, uint8_t reg, uint8_t *data, size_t count);
  bool (*write)(void *context, uint8_t address, uint8_t reg, uint8_t value);
  void *context;
  uint8_t accelerometer_gyroscope; /* 0x6B or 0x6A */
  uint8_t magnetometer;            /* 0x1E or 0x1C */
} lsm9ds1_bus;

typedef struct {
  uint16_t gyroscope_dps;     /* 245, 500, 2000 */
  uint8_t accelerometer_g;    /* 2, 4, 8, 16 */
  uint8_t magnetometer_gauss; /* 4, 8, 12, 16 */
  uint32_t rate_mhz;          /* 14900, 59500, 119000, 238000, 476000, 952000 */
  uint32_t magnetometer_rate_mhz; /* 625, 1250, 2500, 5000, 10000, 20000, 40000, 80000 */
  bool magnetometer_temperature_compensation;
} lsm9ds1_settings;

/* Register values for the settings, in the order of the protocol's dump; false: no such value. */
bool lsm9ds1_register_values(const lsm9ds1_settings *settings,
                             uint8_t values[LSM9DS1_REGISTERS]);
/* Checks both WHO_AM_I, resets, writes every register and reads it back. */
bool lsm9ds1_set_up(const lsm9ds1_bus *bus, const lsm9ds1_settings *settings);
/* Writes the registers that differ from what the device holds: a change while measuring. */
bool lsm9ds1_change(const lsm9ds1_bus *bus, const lsm9ds1_settings *settings);
bool lsm9ds1_who_am_i(const lsm9ds1_bus *bus, uint8_t who_am_i[2]);
bool lsm9ds1_dump(const lsm9ds1_bus *bus, uint8_t values[LSM9DS1_REGISTERS]);
/* What a dump says the device measures with. */
void lsm9ds1_settings_of(const uint8_t values[LSM9DS1_REGISTERS], lsm9ds1_settings *settings);
/* Temperature, gyroscope and accelerometer counts; magnetometer counts where it has new ones. */
bool lsm9ds1_read(const lsm9ds1_bus *bus, int16_t *temperature, bool *temperature_new,
                  int16_t counts[9], bool *magnetometer_new);

#endif
