/* Numbers that move in straight lines.

   Line l begins at sample begins[l], ascending, and goes from lows to highs (lines, columns) in
   lengths[l] samples; there it stays until the next one begins. What is exactly where a line begins
   belongs to the one before; the first one holds for whatever comes before the second. */
#include "core.h"

#include <math.h>

#define TOGETHER 512 /* samples that are smoothed side by side: the nearest cache holds them */

/* The numbers of line l, from `column` on, before a sample. */
static void read(const int64_t *begins, const int64_t *lengths, const double *lows,
                 const double *highs, int64_t columns, int64_t l, int64_t column, int64_t sample,
                 double *restrict out) {
  const double *low = lows + l * columns, *high = highs + l * columns;
  const int64_t passed = sample - begins[l];
  const double share = passed < lengths[l] ? (double)passed / (double)lengths[l] : 1.0;
  VECTORS
  for (int64_t c = column; c < columns; c++)
    out[c - column] = share < 1 ? low[c] + share * (high[c] - low[c]) : high[c];
}

/* gaps (updates,): how long lines are likely to last, by an interval that follows with a share
   `calm` what lay `between` updates, in samples, but for what is no interval. */
ENTRY void lines_expect(const int64_t *between, int64_t updates, double shortest, double longest,
                        double calm, double *interval, int64_t *gaps) {
  for (int64_t k = 0; k < updates; k++) {
    const double samples = (double)between[k];
    if (shortest <= samples && samples <= longest) *interval += calm * (samples - *interval);
    gaps[k] = most(1, (int64_t)rint(*interval));
  }
}

/* Fill in where all lines but the first begin: where the one before is by then. Where its first
   number is 0 and stays so, numbers from `kept` on begin where they end. */
ENTRY void lines_join(const int64_t *begins, const int64_t *lengths, double *lows,
                      const double *highs, int64_t lines, int64_t columns, int64_t kept) {
  for (int64_t l = 1; l < lines; l++) {
    double *low = lows + l * columns;
    read(begins, lengths, lows, highs, columns, l - 1, 0, begins[l], low);
    const int rests = low[0] == 0 && highs[(l - 1) * columns] == 0;
    for (int64_t c = kept; rests && c < columns; c++) low[c] = highs[l * columns + c];
  }
}

/* out (moments, columns - column): the numbers before samples, ascending, from `column` on. */
ENTRY void lines_read(const int64_t *begins, const int64_t *lengths, const double *lows,
                      const double *highs, int64_t lines, int64_t columns, int64_t column,
                      const int64_t *samples, int64_t moments, double *restrict out) {
  for (int64_t k = 0, l = 0; k < moments; k++) {
    while (l + 1 < lines && begins[l + 1] < samples[k]) l++;
    read(begins, lengths, lows, highs, columns, l, column, samples[k],
         out + k * (columns - column));
  }
}

/* out (filled, samples): the first numbers before the samples first + 1, first + 2, ... */
ENTRY void lines_fill(const int64_t *begins, const int64_t *lengths, const double *lows,
                      const double *highs, int64_t lines, int64_t columns, int64_t filled,
                      int64_t first, int64_t samples, double *restrict out) {
  for (int64_t l = 0; l < lines; l++) {
    const int64_t begin = begins[l];
    const int64_t from = l == 0 ? 0 : most(begin - first, 0);
    const int64_t next = l + 1 < lines ? begins[l + 1] - first : samples;
    const int64_t end = least(most(next, from), samples);
    const int64_t there = least(most(begin + lengths[l] - first - 1, from), end);
    for (int64_t column = 0; column < filled; column++) {
      const double low = lows[l * columns + column], high = highs[l * columns + column];
      const double rise = high - low, length = (double)lengths[l];
      double *restrict row = out + column * samples;
      VECTORS
      for (int64_t k = from; k < there; k++)
        row[k] = low + (double)(first + k + 1 - begin) / length * rise;
      for (int64_t k = there; k < end; k++) row[k] = high;
    }
  }
}

/* out (samples,): numbers (samples + taps - 1,) under a window (taps,), its first tap on the last
   of those that it covers. */
ENTRY void lines_smooth(const double *numbers, const double *window, int64_t taps, int64_t samples,
                        double *restrict out) {
  for (int64_t k = 0; k < samples; k++) out[k] = 0.0;
  for (int64_t first = 0; first < samples; first += TOGETHER) {
    const int64_t end = least(first + TOGETHER, samples);
    int64_t tap = 0;
    for (; tap + 3 < taps; tap += 4) { /* four at a time: each number is then stored less often */
      const double *from = numbers + taps - 4 - tap, *w = window + tap;
      VECTORS for (int64_t k = first; k < end; k++)
        out[k] += w[3] * from[k] + w[2] * from[k + 1] + w[1] * from[k + 2] + w[0] * from[k + 3];
    }
    for (; tap < taps; tap++) {
      const double *from = numbers + taps - 1 - tap, weight = window[tap];
      VECTORS for (int64_t k = first; k < end; k++) out[k] += weight * from[k];
    }
  }
}
