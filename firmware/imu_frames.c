/* SPDX-License-Identifier: Apache-2.0 */
#include "imu_frames.h"

#include <string.h>

enum { TYPE_DATA = 0x10, TYPE_INFORMATION = 0x20, TYPE_ACKNOWLEDGEMENT = 0x30, TYPE_COMMAND = 0x40 };

uint16_t imu_crc16(const uint8_t *data, size_t length) {
  uint32_t crc = 0xFFFF;
  for (size_t i = 0; i < length; i++) {
    crc ^= (uint32_t)data[i] << 8;
    for (int bit = 0; bit < 8; bit++) {
      crc = (crc & 0x8000u) ? crc << 1 ^ 0x1021u : crc << 1;
    }
    crc &= 0xFFFF;
  }
  return (uint16_t)crc;
}

size_t imu_cobs_encode(const uint8_t *data, size_t length, uint8_t *out) {
  size_t code = 0, at = 1; /* place of the open group's length byte; next free place */
  for (size_t i = 0; i < length; i++) {
    if (data[i] != 0) {
      out[at++] = data[i];
    }
    bool full = at - code == 255;
    if (data[i] == 0 || (full && i + 1 < length)) {
      out[code] = (uint8_t)(at - code);
      code = at++;
    }
  }
  out[code] = (uint8_t)(at - code);
  return at;
}

size_t imu_cobs_decode(const uint8_t *data, size_t length, uint8_t *out) {
  size_t from = 0, to = 0;
  while (from < length) {
    size_t code = data[from++];
    if (code == 0 || from + code - 1 > length) {
      return SIZE_MAX;
    }
    for (size_t i = 1; i < code; i++) {
      if (data[from] == 0) {
        return SIZE_MAX;
      }
      out[to++] = data[from++];
    }
    if (code < 255 && from < length) {
      out[to++] = 0;
    }
  }
  return to;
}

/* Writing: the same calls put a field into a binary payload or into a line. ------------------- */

typedef struct {
  imu_encoding encoding;
  size_t length;
  uint8_t bytes[IMU_MAXIMUM_FRAME];
} body;

static void put_byte(body *b, uint8_t byte) {
  if (b->length < sizeof b->bytes) {
    b->bytes[b->length++] = byte;
  }
}

static void put_text(body *b, const char *text) {
  while (*text != '\0') {
    put_byte(b, (uint8_t)*text++);
  }
}

static void put_decimal(body *b, uint32_t value) {
  char digits[10];
  size_t count = 0;
  do {
    digits[count++] = (char)('0' + value % 10);
    value /= 10;
  } while (value != 0);
  while (count > 0) {
    put_byte(b, (uint8_t)digits[--count]);
  }
}

static void put_hex(body *b, uint32_t value, int digits) {
  while (digits-- > 0) {
    put_byte(b, (uint8_t)"0123456789ABCDEF"[value >> (4 * digits) & 0xF]);
  }
}

static void put_unsigned(body *b, uint32_t value, int size) {
  if (b->encoding == IMU_ASCII) {
    put_byte(b, ',');
    put_decimal(b, value);
    return;
  }
  for (int i = 0; i < size; i++) {
    put_byte(b, (uint8_t)(value >> (8 * i)));
  }
}

static void put_signed16(body *b, int16_t value) {
  if (b->encoding == IMU_ASCII && value < 0) {
    put_text(b, ",-");
    put_decimal(b, (uint32_t) - (int32_t)value);
    return;
  }
  put_unsigned(b, (uint16_t)value, 2);
}

static void put_bytes(body *b, const uint8_t *bytes, size_t count) {
  if (b->encoding == IMU_ASCII) {
    put_byte(b, ',');
  }
  for (size_t i = 0; i < count; i++) {
    if (b->encoding == IMU_ASCII) {
      put_hex(b, bytes[i], 2);
    } else {
      put_byte(b, bytes[i]);
    }
  }
}

static void put_head(body *b, uint8_t type, const char *name) {
  if (b->encoding == IMU_ASCII) {
    put_text(b, name);
  } else {
    put_byte(b, type);
  }
}

static size_t finish(const body *b, uint8_t *out) {
  uint16_t crc = imu_crc16(b->bytes, b->length);
  body frame = *b;
  if (b->encoding == IMU_BINARY) {
    put_byte(&frame, (uint8_t)(crc >> 8));
    put_byte(&frame, (uint8_t)crc);
    size_t length = imu_cobs_encode(frame.bytes, frame.length, out);
    out[length++] = 0;
    return length;
  }
  body line = {.encoding = IMU_ASCII};
  put_byte(&line, '$');
  for (size_t i = 0; i < b->length; i++) {
    put_byte(&line, b->bytes[i]);
  }
  put_byte(&line, '*');
  put_hex(&line, crc, 4);
  put_text(&line, "\r\n");
  memcpy(out, line.bytes, line.length);
  return line.length;
}

size_t imu_encode_data(imu_encoding encoding, const imu_data *frame, uint8_t *out) {
  body b = {.encoding = encoding};
  put_head(&b, (uint8_t)(TYPE_DATA | (frame->flags & 0xF)), "IMU");
  put_unsigned(&b, frame->sequence, 2);
  put_unsigned(&b, frame->tick, 4);
  if (encoding == IMU_ASCII) {
    put_byte(&b, ',');
    put_hex(&b, frame->flags & 0xF, 1);
  }
  put_signed16(&b, frame->temperature);
  for (int i = 0; i < 9; i++) {
    put_signed16(&b, frame->counts[i]);
  }
  return finish(&b, out);
}

size_t imu_encode_information(imu_encoding encoding, const imu_information *frame, uint8_t *out) {
  body b = {.encoding = encoding};
  put_head(&b, TYPE_INFORMATION, "INF");
  put_unsigned(&b, frame->version, 1);
  if (encoding == IMU_ASCII) {
    put_byte(&b, ',');
    put_hex(&b, frame->flags & 0xF, 1);
  } else {
    put_byte(&b, frame->flags);
  }
  put_unsigned(&b, frame->tick, 4);
  put_unsigned(&b, frame->samples, 4);
  if (encoding == IMU_ASCII) {
    put_byte(&b, ',');
    put_text(&b, frame->serial_number);
    for (int i = 0; i < 3; i++) {
      put_byte(&b, i == 0 ? ',' : '.');
      put_decimal(&b, frame->firmware[i]);
    }
  } else {
    uint8_t padded[16] = {0};
    memcpy(padded, frame->serial_number, strlen(frame->serial_number));
    put_bytes(&b, padded, sizeof padded);
    put_bytes(&b, frame->firmware, sizeof frame->firmware);
  }
  put_unsigned(&b, frame->tick_rate, 4);
  put_unsigned(&b, frame->gyroscope_dps, 2);
  put_unsigned(&b, frame->accelerometer_g, 1);
  put_unsigned(&b, frame->magnetometer_gauss, 1);
  put_unsigned(&b, frame->rate_mhz, 4);
  put_unsigned(&b, frame->magnetometer_rate_mhz, 4);
  put_unsigned(&b, frame->i2c_errors, 4);
  put_unsigned(&b, frame->overruns, 4);
  put_unsigned(&b, frame->command_errors, 4);
  put_unsigned(&b, frame->supply_mv, 2);
  put_bytes(&b, frame->who_am_i, sizeof frame->who_am_i);
  put_bytes(&b, frame->registers, sizeof frame->registers);
  return finish(&b, out);
}

size_t imu_encode_acknowledgement(imu_encoding encoding, const imu_acknowledgement *frame,
                                  uint8_t *out) {
  body b = {.encoding = encoding};
  put_head(&b, TYPE_ACKNOWLEDGEMENT, "ACK");
  put_unsigned(&b, frame->command, 1);
  put_unsigned(&b, frame->number, 1);
  put_unsigned(&b, frame->status, 1);
  put_unsigned(&b, frame->value, 4);
  return finish(&b, out);
}

/* Reading commands. ---------------------------------------------------------------------------- */

static bool decode_binary(const uint8_t *encoded, size_t length, imu_command *command) {
  uint8_t payload[IMU_MAXIMUM_FRAME];
  size_t size = imu_cobs_decode(encoded, length, payload);
  if (size != 9 || imu_crc16(payload, size) != 0 || payload[0] != TYPE_COMMAND) {
    return false;
  }
  command->command = payload[1];
  command->number = payload[2];
  command->value = (uint32_t)payload[3] | (uint32_t)payload[4] << 8 | (uint32_t)payload[5] << 16 |
                   (uint32_t)payload[6] << 24;
  return true;
}

static bool take_number(const uint8_t **at, const uint8_t *end, uint32_t limit, uint32_t *value) {
  const uint8_t *first = *at;
  uint32_t result = 0;
  while (*at < end && **at >= '0' && **at <= '9') {
    uint32_t digit = (uint32_t)(**at - '0');
    if (result > (limit - digit) / 10) {
      return false;
    }
    result = result * 10 + digit;
    (*at)++;
  }
  *value = result;
  return *at > first && (*at == first + 1 || *first != '0');
}

static bool decode_line(const uint8_t *line, size_t length, imu_command *command) {
  const uint8_t *end = line + length, *start = end;
  while (start > line && start[-1] != '$') {
    start--;
  }
  if (start == line || end - start < 5 || end[-5] != '*') {
    return false;
  }
  uint16_t crc = imu_crc16(start, (size_t)(end - 5 - start));
  for (int i = 0; i < 4; i++) {
    if (end[i - 4] != (uint8_t)"0123456789ABCDEF"[crc >> (12 - 4 * i) & 0xF]) {
      return false;
    }
  }
  end -= 5;
  uint32_t fields[3];
  const uint32_t limits[3] = {0xFF, 0xFF, 0xFFFFFFFF};
  if (end - start < 4 || memcmp(start, "CMD,", 4) != 0) {
    return false;
  }
  start += 4;
  for (int i = 0; i < 3; i++) {
    if (!take_number(&start, end, limits[i], &fields[i]) ||
        (i < 2 && (start == end || *start++ != ','))) {
      return false;
    }
  }
  command->command = (uint8_t)fields[0];
  command->number = (uint8_t)fields[1];
  command->value = fields[2];
  return start == end;
}

bool imu_read_command(imu_command_reader *reader, uint8_t byte, imu_command *command) {
  uint8_t delimiter = reader->encoding == IMU_ASCII ? '\n' : 0;
  if (byte != delimiter) {
    if (reader->length < sizeof reader->bytes) {
      reader->bytes[reader->length++] = byte;
    } else {
      reader->overlong = true;
    }
    return false;
  }
  size_t length = reader->length;
  bool overlong = reader->overlong, done = false;
  reader->length = 0;
  reader->overlong = false;
  if (reader->encoding == IMU_ASCII && length > 0 && reader->bytes[length - 1] == '\r') {
    length--;
  }
  if (length == 0) {
    return false;
  }
  if (!overlong) {
    done = reader->encoding == IMU_ASCII ? decode_line(reader->bytes, length, command)
                                         : decode_binary(reader->bytes, length, command);
  }
  reader->errors += !done;
  return done;
}
