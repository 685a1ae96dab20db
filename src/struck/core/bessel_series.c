/* Chebyshev series of TERMS terms over cells one wide: at argument x the cell is floor(x), and

     sum_d table[cell][d] T_d(t),  t = 2 (x - cell) - 1,

   by Clenshaw's recurrence b_d = 2 t b_(d+1) - b_(d+2) + table[cell][d] (Clenshaw 1955).
   The recurrence stays in registers: the loop over the series is what becomes vectors.

   table (cells, TERMS, count); arguments (points,) from 0 to below cells; sums (points, count). */
#include "core.h"

enum { TERMS = 13 };

ENTRY void bessel_series_sum(int64_t points, int64_t count, const double *arguments,
                             const double *restrict table, double *restrict sums) {
  for (int64_t i = 0; i < points; i++) {
    const int64_t cell = (int64_t)arguments[i];
    const double at = 2 * (arguments[i] - (double)cell) - 1;
    const double *here = table + cell * TERMS * count;
    double *sum = sums + i * count;
    VECTORS
    for (int64_t j = 0; j < count; j++) {
      double one = 0, two = 0;
#pragma clang loop unroll(full)
      for (int64_t degree = TERMS - 1; degree > 0; degree--) {
        const double next = 2 * at * one - two + here[degree * count + j];
        two = one;
        one = next;
      }
      sum[j] = at * one - two + here[j];
    }
  }
}

/* The derivatives by the argument: the recurrence differentiated runs beside it. */
ENTRY void bessel_series_slope(int64_t points, int64_t count, const double *arguments,
                               const double *restrict table, double *restrict slopes) {
  for (int64_t i = 0; i < points; i++) {
    const int64_t cell = (int64_t)arguments[i];
    const double at = 2 * (arguments[i] - (double)cell) - 1;
    const double *here = table + cell * TERMS * count;
    double *sum = slopes + i * count;
    VECTORS
    for (int64_t j = 0; j < count; j++) {
      double one = 0, two = 0, slope = 0, older = 0;
#pragma clang loop unroll(full)
      for (int64_t degree = TERMS - 1; degree > 0; degree--) {
        const double steeper = 2 * one + 2 * at * slope - older;
        const double next = 2 * at * one - two + here[degree * count + j];
        older = slope;
        slope = steeper;
        two = one;
        one = next;
      }
      sum[j] = 2 * (one + at * slope - older);
    }
  }
}
