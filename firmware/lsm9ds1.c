/* SPDX-License-Identifier: Apache-2.0 */
#include "lsm9ds1.h"

enum {
  WHO_AM_I = 0x0F,
  WHO_AM_I_AG_VALUE = 0x68,
  WHO_AM_I_M_VALUE = 0x3D,
  OUT_TEMP_L = 0x15,
  OUT_X_L_G = 0x18,
  OUT_X_L_XL = 0x28,
  STATUS_REG = 0x17,
  STATUS_REG_M = 0x27,
  OUT_X_L_M = 0x28,
  CTRL_REG8 = 0x22,
  SW_RESET = 0x01,
  SOFT_RST_M = 0x04,
  CTRL_REG2_M = 0x21,
  TEMPERATURE_READY = 0x04, /* TDA of STATUS_REG */
  MAGNETOMETER_READY = 0x08, /* ZYXDA of STATUS_REG_M */
  MULTIPLE_M = 0x80, /* the magnetometer increments only under this sub-address bit */
  FIRST_M = 11 /* index of CTRL_REG1_M in the dump */
};

static const uint8_t ADDRESSES[LSM9DS1_REGISTERS] = {
    0x10, 0x11, 0x12, 0x13, 0x1E, 0x1F, 0x20, 0x21, 0x22, 0x23, 0x24, /* CTRL_REG1_G … 10 */
    0x20, 0x21, 0x22, 0x23, 0x24,                                     /* CTRL_REG1_M … 5_M */
};

typedef struct {
  uint32_t value;
  uint8_t code;
} choice;

static const choice GYROSCOPE[] = {{245, 0}, {500, 1}, {2000, 3}};
static const choice ACCELEROMETER[] = {{2, 0}, {4, 2}, {8, 3}, {16, 1}}; /* code 1 is 16 g */
static const choice MAGNETOMETER[] = {{4, 0}, {8, 1}, {12, 2}, {16, 3}};
static const choice RATE[] = {{14900, 1}, {59500, 2}, {119000, 3},
                              {238000, 4}, {476000, 5}, {952000, 6}};
static const choice MAGNETOMETER_RATE[] = {{625, 0},   {1250, 1},  {2500, 2},  {5000, 3},
                                           {10000, 4}, {20000, 5}, {40000, 6}, {80000, 7}};
#define COUNT(table) (sizeof(table) / sizeof(table)[0])

static bool find(const choice *table, size_t count, uint32_t value, uint8_t *code) {
  for (size_t i = 0; i < count; i++) {
    if (table[i].value == value) {
      *code = table[i].code;
      return true;
    }
  }
  return false;
}

static uint32_t value_of(const choice *table, size_t count, uint8_t code) {
  for (size_t i = 0; i < count; i++) {
    if (table[i].code == code) {
      return table[i].value;
    }
  }
  return 0;
}

bool lsm9ds1_register_values(const lsm9ds1_settings *s, uint8_t values[LSM9DS1_REGISTERS]) {
  uint8_t g, a, m, rate, m_rate;
  if (!find(GYROSCOPE, COUNT(GYROSCOPE), s->gyroscope_dps, &g) ||
      !find(ACCELEROMETER, COUNT(ACCELEROMETER), s->accelerometer_g, &a) ||
      !find(MAGNETOMETER, COUNT(MAGNETOMETER), s->magnetometer_gauss, &m) ||
      !find(RATE, COUNT(RATE), s->rate_mhz, &rate) ||
      !find(MAGNETOMETER_RATE, COUNT(MAGNETOMETER_RATE), s->magnetometer_rate_mhz, &m_rate)) {
    return false;
  }
  const uint8_t all[LSM9DS1_REGISTERS] = {
      (uint8_t)(rate << 5 | g << 3), /* CTRL_REG1_G: ODR, FS */
      0x00, 0x00, 0x00,              /* CTRL_REG2_G, CTRL_REG3_G, ORIENT_CFG_G: no filter */
      0x38,                          /* CTRL_REG4: gyroscope axes on */
      0x38,                          /* CTRL_REG5_XL: accelerometer axes on */
      (uint8_t)(rate << 5 | a << 3), /* CTRL_REG6_XL: ODR, FS */
      0x00,                          /* CTRL_REG7_XL */
      0x44,                          /* CTRL_REG8: block data update, address increment */
      0x00, 0x00,                    /* CTRL_REG9, CTRL_REG10 */
      (uint8_t)((s->magnetometer_temperature_compensation ? 0x80 : 0) | 0x60 | m_rate << 2),
      (uint8_t)(m << 5), /* CTRL_REG2_M: FS */
      0x00,              /* CTRL_REG3_M: continuous */
      0x0C,              /* CTRL_REG4_M: best performance in z too */
      0x40,              /* CTRL_REG5_M: block data update */
  };
  for (size_t i = 0; i < LSM9DS1_REGISTERS; i++) {
    values[i] = all[i];
  }
  return true;
}

static uint8_t device_of(const lsm9ds1_bus *bus, size_t index) {
  return index < FIRST_M ? bus->accelerometer_gyroscope : bus->magnetometer;
}

bool lsm9ds1_who_am_i(const lsm9ds1_bus *bus, uint8_t who_am_i[2]) {
  return bus->read(bus->context, bus->accelerometer_gyroscope, WHO_AM_I, &who_am_i[0], 1) &&
         bus->read(bus->context, bus->magnetometer, WHO_AM_I, &who_am_i[1], 1);
}

bool lsm9ds1_dump(const lsm9ds1_bus *bus, uint8_t values[LSM9DS1_REGISTERS]) {
  for (size_t i = 0; i < LSM9DS1_REGISTERS; i++) {
    if (!bus->read(bus->context, device_of(bus, i), ADDRESSES[i], &values[i], 1)) {
      return false;
    }
  }
  return true;
}

bool lsm9ds1_change(const lsm9ds1_bus *bus, const lsm9ds1_settings *settings) {
  uint8_t wanted[LSM9DS1_REGISTERS], held[LSM9DS1_REGISTERS];
  if (!lsm9ds1_register_values(settings, wanted) || !lsm9ds1_dump(bus, held)) {
    return false;
  }
  for (size_t i = 0; i < LSM9DS1_REGISTERS; i++) {
    if (wanted[i] != held[i] &&
        !bus->write(bus->context, device_of(bus, i), ADDRESSES[i], wanted[i])) {
      return false;
    }
  }
  if (!lsm9ds1_dump(bus, held)) {
    return false;
  }
  for (size_t i = 0; i < LSM9DS1_REGISTERS; i++) {
    if (wanted[i] != held[i]) {
      return false;
    }
  }
  return true;
}

bool lsm9ds1_set_up(const lsm9ds1_bus *bus, const lsm9ds1_settings *settings) {
  uint8_t who[2], state;
  if (!lsm9ds1_who_am_i(bus, who) || who[0] != WHO_AM_I_AG_VALUE || who[1] != WHO_AM_I_M_VALUE ||
      !bus->write(bus->context, bus->accelerometer_gyroscope, CTRL_REG8, SW_RESET) ||
      !bus->write(bus->context, bus->magnetometer, CTRL_REG2_M, SOFT_RST_M)) {
    return false;
  }
  for (int tries = 0; tries < 1000; tries++) { /* both bits clear themselves within 50 µs */
    uint8_t magnetometer;
    if (bus->read(bus->context, bus->accelerometer_gyroscope, CTRL_REG8, &state, 1) &&
        bus->read(bus->context, bus->magnetometer, CTRL_REG2_M, &magnetometer, 1) &&
        (state & SW_RESET) == 0 && (magnetometer & SOFT_RST_M) == 0) {
      return lsm9ds1_change(bus, settings);
    }
  }
  return false;
}

void lsm9ds1_settings_of(const uint8_t values[LSM9DS1_REGISTERS], lsm9ds1_settings *s) {
  s->gyroscope_dps = (uint16_t)value_of(GYROSCOPE, COUNT(GYROSCOPE), values[0] >> 3 & 3);
  s->accelerometer_g = (uint8_t)value_of(ACCELEROMETER, COUNT(ACCELEROMETER), values[6] >> 3 & 3);
  s->magnetometer_gauss =
      (uint8_t)value_of(MAGNETOMETER, COUNT(MAGNETOMETER), values[FIRST_M + 1] >> 5 & 3);
  s->rate_mhz = value_of(RATE, COUNT(RATE), values[0] >> 5);
  s->magnetometer_rate_mhz =
      value_of(MAGNETOMETER_RATE, COUNT(MAGNETOMETER_RATE), values[FIRST_M] >> 2 & 7);
  s->magnetometer_temperature_compensation = (values[FIRST_M] & 0x80) != 0;
}

static int16_t count_of(const uint8_t *bytes) { return (int16_t)(bytes[0] | bytes[1] << 8); }

bool lsm9ds1_read(const lsm9ds1_bus *bus, int16_t *temperature, bool *temperature_new,
                  int16_t counts[9], bool *magnetometer_new) {
  uint8_t raw[9], force[6], field[6], status_m; /* raw: temperature, status, gyroscope */
  if (!bus->read(bus->context, bus->accelerometer_gyroscope, OUT_TEMP_L, raw, sizeof raw) ||
      !bus->read(bus->context, bus->accelerometer_gyroscope, OUT_X_L_XL, force, sizeof force) ||
      !bus->read(bus->context, bus->magnetometer, STATUS_REG_M, &status_m, 1)) {
    return false;
  }
  *temperature = count_of(raw);
  *temperature_new = (raw[STATUS_REG - OUT_TEMP_L] & TEMPERATURE_READY) != 0;
  *magnetometer_new = (status_m & MAGNETOMETER_READY) != 0;
  if (*magnetometer_new &&
      !bus->read(bus->context, bus->magnetometer, OUT_X_L_M | MULTIPLE_M, field, sizeof field)) {
    return false;
  }
  for (int i = 0; i < 3; i++) {
    counts[i] = count_of(&raw[OUT_X_L_G - OUT_TEMP_L + 2 * i]);
    counts[3 + i] = count_of(&force[2 * i]);
    if (*magnetometer_new) {
      counts[6 + i] = count_of(&field[2 * i]);
    }
  }
  return true;
}
