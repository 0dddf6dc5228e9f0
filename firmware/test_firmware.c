/* SPDX-License-Identifier: Apache-2.0 */
/* Checks the frames against test_vectors.txt and the board against a sensor of bytes. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "imu_board.h"

static int checks, failures;

#define CHECK(condition, ...)                        \
  do {                                               \
    checks++;                                        \
    if (!(condition)) {                              \
      failures++;                                    \
      printf("FAILED %s:%d: ", __FILE__, __LINE__);  \
      printf(__VA_ARGS__);                           \
      printf("\n");                                  \
    }                                                \
  } while (0)

/* Vectors. ------------------------------------------------------------------------------------- */

static char *fields[32];
static int field_count;

static size_t bytes_of(const char *hex, uint8_t *out) {
  size_t count = strcmp(hex, "-") == 0 ? 0 : strlen(hex) / 2;
  for (size_t i = 0; i < count; i++) {
    unsigned value;
    sscanf(hex + 2 * i, "%2x", &value);
    out[i] = (uint8_t)value;
  }
  return count;
}

static uint32_t number(int index) { return (uint32_t)strtoll(fields[index], NULL, 10); }

static void check_frame(const uint8_t *out, size_t length, imu_encoding encoding) {
  uint8_t wanted[IMU_MAXIMUM_FRAME];
  if (encoding == IMU_BINARY) {
    size_t size = bytes_of(fields[field_count - 2], wanted);
    CHECK(length == size && memcmp(out, wanted, size) == 0, "%s binary", fields[0]);
  } else {
    size_t size = strlen(fields[field_count - 1]);
    CHECK(length == size + 2 && memcmp(out, fields[field_count - 1], size) == 0 &&
              memcmp(out + size, "\r\n", 2) == 0,
          "%s ascii", fields[0]);
  }
}

static void check_data(imu_encoding encoding) {
  uint8_t out[IMU_MAXIMUM_FRAME];
  imu_data frame = {(uint16_t)number(1), number(2), (uint8_t)number(3), (int16_t)number(4), {0}};
  for (int i = 0; i < 9; i++) {
    frame.counts[i] = (int16_t)number(5 + i);
  }
  check_frame(out, imu_encode_data(encoding, &frame, out), encoding);
}

static void check_information(imu_encoding encoding) {
  uint8_t out[IMU_MAXIMUM_FRAME];
  imu_information frame = {
      .version = (uint8_t)number(1),
      .flags = (uint8_t)number(2),
      .tick = number(3),
      .samples = number(4),
      .firmware = {(uint8_t)number(6), (uint8_t)number(7), (uint8_t)number(8)},
      .tick_rate = number(9),
      .gyroscope_dps = (uint16_t)number(10),
      .accelerometer_g = (uint8_t)number(11),
      .magnetometer_gauss = (uint8_t)number(12),
      .rate_mhz = number(13),
      .magnetometer_rate_mhz = number(14),
      .i2c_errors = number(15),
      .overruns = number(16),
      .command_errors = number(17),
      .supply_mv = (uint16_t)number(18),
  };
  strcpy(frame.serial_number, fields[5]);
  bytes_of(fields[19], frame.who_am_i);
  bytes_of(fields[20], frame.registers);
  check_frame(out, imu_encode_information(encoding, &frame, out), encoding);
}

static void check_acknowledgement(imu_encoding encoding) {
  uint8_t out[IMU_MAXIMUM_FRAME];
  imu_acknowledgement frame = {(uint8_t)number(1), (uint8_t)number(2), (uint8_t)number(3),
                               number(4)};
  check_frame(out, imu_encode_acknowledgement(encoding, &frame, out), encoding);
}

static bool feed(imu_command_reader *reader, const uint8_t *bytes, size_t count,
                 imu_command *command) {
  bool found = false;
  for (size_t i = 0; i < count; i++) {
    found |= imu_read_command(reader, bytes[i], command);
  }
  return found;
}

static void check_command(imu_encoding encoding) {
  static const uint8_t NOISE[] = "\x01other protocol";
  uint8_t wire[IMU_MAXIMUM_FRAME + 2];
  imu_command_reader reader = {.encoding = encoding};
  imu_command command = {0};
  size_t size;
  if (encoding == IMU_BINARY) {
    size = bytes_of(fields[field_count - 2], wire);
  } else {
    size = (size_t)sprintf((char *)wire, "%s\r\n", fields[field_count - 1]);
  }
  CHECK(!feed(&reader, NOISE, sizeof NOISE - 1, &command), "noise is a command");
  feed(&reader, encoding == IMU_BINARY ? (const uint8_t *)"" : (const uint8_t *)"\n", 1, &command);
  CHECK(reader.errors == 1, "noise is one error");
  CHECK(feed(&reader, wire, size, &command), "%s %s is not read", fields[0], fields[1]);
  CHECK(command.command == number(1) && command.number == number(2) &&
            command.value == number(3),
        "%s %s is misread", fields[0], fields[1]);
  for (size_t i = 0; i + 1 < size; i++) { /* no flipped bit goes unnoticed */
    for (int bit = 0; bit < 8; bit++) {
      uint8_t bad[IMU_MAXIMUM_FRAME + 2];
      memcpy(bad, wire, size);
      bad[i] ^= (uint8_t)(1u << bit);
      reader = (imu_command_reader){.encoding = encoding};
      if (encoding == IMU_ASCII && i == size - 2) {
        continue; /* the carriage return may be missing, so it carries nothing */
      }
      CHECK(!feed(&reader, bad, size, &command), "bit %d of byte %zu flipped is read", bit, i);
    }
  }
}

static void check_line(void) {
  uint8_t in[IMU_MAXIMUM_FRAME], out[IMU_MAXIMUM_FRAME], wanted[IMU_MAXIMUM_FRAME];
  if (strcmp(fields[0], "crc") == 0) {
    size_t size = bytes_of(fields[1], in);
    CHECK(imu_crc16(in, size) == strtoul(fields[2], NULL, 16), "crc %s", fields[1]);
  } else if (strcmp(fields[0], "cobs") == 0) {
    size_t size = bytes_of(fields[1], in), encoded = imu_cobs_encode(in, size, out);
    CHECK(encoded == bytes_of(fields[2], wanted) && memcmp(out, wanted, encoded) == 0, "cobs %s",
          fields[1]);
    CHECK(imu_cobs_decode(wanted, encoded, out) == size && memcmp(out, in, size) == 0,
          "cobs back %s", fields[1]);
  } else if (strcmp(fields[0], "reject") == 0) {
    imu_command_reader reader = {.encoding = IMU_BINARY};
    imu_command command;
    CHECK(!feed(&reader, in, bytes_of(fields[2], in), &command), "accepted %s", fields[2]);
  } else if (strcmp(fields[0], "registers") == 0) {
    lsm9ds1_settings settings = {(uint16_t)number(1), (uint8_t)number(2), (uint8_t)number(3),
                                 number(4), number(5), number(6) != 0};
    lsm9ds1_settings back;
    CHECK(lsm9ds1_register_values(&settings, out), "registers refused");
    bytes_of(fields[7], wanted);
    CHECK(memcmp(out, wanted, LSM9DS1_REGISTERS) == 0, "registers %s", fields[7]);
    lsm9ds1_settings_of(out, &back);
    CHECK(back.gyroscope_dps == settings.gyroscope_dps &&
              back.accelerometer_g == settings.accelerometer_g &&
              back.magnetometer_gauss == settings.magnetometer_gauss &&
              back.rate_mhz == settings.rate_mhz &&
              back.magnetometer_rate_mhz == settings.magnetometer_rate_mhz,
          "registers back %s", fields[7]);
  } else {
    for (imu_encoding encoding = IMU_BINARY; encoding <= IMU_ASCII; encoding++) {
      switch (fields[0][0]) {
        case 'd': check_data(encoding); break;
        case 'i': check_information(encoding); break;
        case 'a': check_acknowledgement(encoding); break;
        case 'c': check_command(encoding); break;
        default: CHECK(false, "unknown vector %s", fields[0]);
      }
    }
  }
}

static int check_vectors(const char *path) {
  char line[1024];
  int count = 0;
  FILE *file = fopen(path, "r");
  if (file == NULL) {
    perror(path);
    return 0;
  }
  while (fgets(line, sizeof line, file) != NULL) {
    if (line[0] == '#') {
      continue;
    }
    field_count = 0;
    for (char *field = strtok(line, " \n"); field != NULL; field = strtok(NULL, " \n")) {
      fields[field_count++] = field;
    }
    if (field_count > 0) {
      check_line();
      count++;
    }
  }
  fclose(file);
  return count;
}

/* A sensor of bytes and a board on it. --------------------------------------------------------- */

static uint8_t sensor[2][256]; /* accelerometer and gyroscope, magnetometer */
static bool bus_works = true, room = true;
static uint8_t sent[4096];
static size_t sent_count;

static bool read_bus(void *context, uint8_t address, uint8_t reg, uint8_t *data, size_t count) {
  (void)context;
  for (size_t i = 0; i < count; i++) {
    data[i] = sensor[address == 0x1E][(reg & 0x7F) + i];
  }
  return bus_works;
}

static bool write_bus(void *context, uint8_t address, uint8_t reg, uint8_t value) {
  (void)context;
  bool is_reset = address == 0x1E ? reg == 0x21 && value == 4 : reg == 0x22 && value == 1;
  sensor[address == 0x1E][reg] = is_reset ? 0 : value;
  return bus_works;
}

static bool take(void *context, const uint8_t *bytes, size_t length) {
  (void)context;
  if (room) {
    memcpy(sent + sent_count, bytes, length);
    sent_count += length;
  }
  return room;
}

static size_t next_frame(size_t *at, uint8_t *payload) {
  size_t end = *at;
  while (end < sent_count && sent[end] != 0) {
    end++;
  }
  size_t length = imu_cobs_decode(sent + *at, end - *at, payload);
  *at = end + 1;
  return end < sent_count && imu_crc16(payload, length) == 0 ? length - 2 : 0;
}

static void command(imu_board *board, const char *wire) {
  uint8_t bytes[64];
  size_t count = bytes_of(wire, bytes);
  sent_count = 0;
  for (size_t i = 0; i < count; i++) {
    imu_board_receive(board, bytes[i], 5000);
  }
}

static void check_board(void) {
  imu_board board = {
      .bus = {read_bus, write_bus, NULL, 0x6B, 0x1E},
      .send = take,
      .serial_number = "BOARD1",
      .firmware = {1, 2, 3},
  };
  uint8_t payload[IMU_MAXIMUM_FRAME];
  size_t at = 0;
  sensor[0][0x0F] = 0x68;
  sensor[1][0x0F] = 0x3D;
  imu_board_start(&board, 1000);
  CHECK(next_frame(&at, payload) == 78 && payload[0] == 0x20 && payload[1] == 1, "information");
  CHECK(memcmp(payload + 11, "BOARD1", 7) == 0 && payload[36] == 2, "identity, 2 g");
  CHECK(sensor[0][0x10] == 0x80 && sensor[0][0x22] == 0x44 && sensor[1][0x20] == 0x7C, "set up");

  imu_board_sample(&board, 2000);
  CHECK(board.samples == 0, "no data before start");
  command(&board, "04400201010101030d3300"); /* start, number 1 */
  at = 0;
  CHECK(next_frame(&at, payload) == 8 && payload[0] == 0x30 && payload[3] == IMU_DONE, "answer");
  CHECK(next_frame(&at, payload) == 78 && payload[2] == IMU_STREAMING, "streaming is told");

  sensor[0][0x17] = 0x07; /* accelerometer, gyroscope, temperature new */
  sensor[0][0x18] = 0xFE;
  sensor[0][0x19] = 0xFF; /* gyroscope x −2 */
  sensor[0][0x2D] = 0x40; /* accelerometer z 16384 */
  sensor[1][0x27] = 0x08;
  sensor[1][0x28] = 0x07; /* magnetometer x 7 */
  sent_count = at = 0;
  imu_board_sample(&board, 70000);
  sensor[1][0x27] = 0;
  sensor[1][0x28] = 0x55;
  imu_board_sample(&board, 74202);
  CHECK(next_frame(&at, payload) == 27 && payload[0] == 0x13, "data, all new");
  CHECK(payload[1] == 0 && payload[3] == 0x70 && payload[4] == 0x11, "sequence, tick");
  CHECK(payload[9] == 0xFE && payload[10] == 0xFF && payload[20] == 0x40, "counts");
  CHECK(next_frame(&at, payload) == 27 && payload[0] == 0x12 && payload[1] == 1, "field not new");
  CHECK(payload[21] == 7, "and held");

  room = false;
  imu_board_sample(&board, 78404);
  room = true;
  CHECK(board.samples == 3 && board.overruns == 1, "a sample without room is counted");

  command(&board, "0540050410010103fd8200"); /* accelerometer 16 g, number 4 */
  CHECK(sensor[0][0x20] == 0x88 && board.configuration == 1, "16 g is code 1");
  command(&board, "0540050410010103fd8200");
  CHECK(board.configuration == 1, "the same again changes nothing");
  command(&board, "074007ffc0860e03a79d00"); /* 952 Hz */
  CHECK(sensor[0][0x10] == 0xC0 && sensor[0][0x20] == 0xC8, "952 Hz for both");

  sensor[0][0x20] = 0xC0; /* the sensor falls back to 2 g by itself */
  sent_count = at = 0;
  imu_board_poll(&board, 500000);
  CHECK(sent_count == 0, "once a second is enough");
  imu_board_poll(&board, 1005001);
  CHECK(next_frame(&at, payload) == 78 && payload[36] == 2, "what the sensor holds is told");
  CHECK((payload[2] >> 2 & 3) == 3, "as another configuration");

  bus_works = false;
  imu_board_sample(&board, 1010000);
  CHECK(board.i2c_errors == 1 && board.samples == 4, "a sample that cannot be read is counted");
  bus_works = true;
}

int main(int argc, char **argv) {
  int count = check_vectors(argc > 1 ? argv[1] : "test_vectors.txt");
  check_board();
  printf("%d vectors, %d checks, %d failures\n", count, checks, failures);
  return count > 0 && failures == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}
