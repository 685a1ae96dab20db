/* Numbers that move in straight lines, read at the end of each sample.

   Line l begins at sample begins[l], ascending, and goes from lows to highs (lines, columns) in
   lengths[l] samples; there it stays until the next one begins. out (columns, samples): the numbers
   before the samples first + 1, first + 2, ..., the first of which the first line holds for. */
#include "core.h"

ENTRY void lines_fill(const int64_t *begins, const int64_t *lengths, const double *lows,
                      const double *highs, int64_t lines, int64_t columns, int64_t first,
                      int64_t samples, double *restrict out) {
  for (int64_t l = 0; l < lines; l++) {
    const int64_t begin = begins[l];
    const int64_t from = l == 0 ? 0 : most(begin - first, 0);
    const int64_t next = l + 1 < lines ? begins[l + 1] - first : samples;
    const int64_t end = least(most(next, from), samples);
    const int64_t there = least(most(begin + lengths[l] - first - 1, from), end);
    for (int64_t column = 0; column < columns; column++) {
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
