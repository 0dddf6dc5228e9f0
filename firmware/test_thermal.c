/* SPDX-License-Identifier: Apache-2.0
 * Runs an exported thermal model over its test vectors.
 * usage: test_thermal VECTORS TOLERANCE   (a share of the correction's range) */
#include "imu_thermal.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { VALUES = sizeof(imu_thermal_sample) / sizeof(imu_thermal_real), ERRORS = 9, SENSORS = 3 };

typedef union {
  imu_thermal_sample sample;
  imu_thermal_real values[VALUES];
} sample_values;

typedef union {
  imu_thermal_error error;
  imu_thermal_real values[ERRORS];
} error_values;

static const char *const SENSOR[SENSORS] = {"gyroscope", "accelerometer", "magnetometer"};

static double next_number(char **text)
{
  char *end;
  const double value = strtod(*text, &end);
  if (end == *text) {
    fprintf(stderr, "a line has too few numbers\n");
    exit(2);
  }
  *text = end;
  return value;
}

int main(int argc, char **argv)
{
  static char line[4096];
  imu_thermal_state state;
  double low[SENSORS], high[SENSORS], worst[SENSORS];
  unsigned long rows = 0;
  int failed = 0;
  FILE *vectors = argc == 3 ? fopen(argv[1], "r") : NULL;

  if (vectors == NULL) {
    fprintf(stderr, "usage: test_thermal VECTORS TOLERANCE\n");
    return 2;
  }
  for (int s = 0; s < SENSORS; s++) {
    low[s] = HUGE_VAL;
    high[s] = -HUGE_VAL;
    worst[s] = 0.0;
  }
  imu_thermal_start(&state);
  while (fgets(line, sizeof line, vectors) != NULL) {
    char *text = line;
    sample_values measured, compensated;
    error_values found;
    long long t;
    imu_thermal_real temperature;

    if (line[0] == '#') {
      continue;
    }
    t = strtoll(text, &text, 10);
    temperature = (imu_thermal_real)next_number(&text);
    for (int i = 0; i < VALUES; i++) {
      measured.values[i] = (imu_thermal_real)next_number(&text);
    }
    compensated = measured;
    (void)imu_thermal_update(&state, t, temperature, &compensated.sample);
    found.error = state.error;
    for (int i = 0; i < ERRORS; i++) {
      const double expected = next_number(&text);
      const double off = fabs((double)found.values[i] - expected);
      const double before = (double)measured.values[i], error = (double)found.values[i];
      const int s = i / 3;

      if (isfinite(expected)) {
        low[s] = fmin(low[s], expected);
        high[s] = fmax(high[s], expected);
        worst[s] = isfinite(off) ? fmax(worst[s], off) : HUGE_VAL;
        if (fabs((double)compensated.values[i] - (before - error)) >
            1e-6 * (fabs(before) + fabs(error))) {
          fprintf(stderr, "row %lu: the error was not subtracted\n", rows);
          failed = 1;
        }
      }
    }
    rows++;
  }
  fclose(vectors);
  for (int s = 0; s < SENSORS; s++) {
    const double range = high[s] - low[s];
    if (range > 0.0) {
      const int holds = worst[s] <= strtod(argv[2], NULL) * range;
      printf("%-14s off by %.1e of the correction's range%s\n", SENSOR[s], worst[s] / range,
             holds ? "" : ": too much");
      failed |= !holds;
    }
  }
  printf("%lu samples, %s precision, state %lu bytes\n", rows,
         sizeof(imu_thermal_real) == sizeof(double) ? "double" : "single",
         (unsigned long)sizeof(imu_thermal_state));
  return failed || rows == 0 ? 1 : 0;
}
