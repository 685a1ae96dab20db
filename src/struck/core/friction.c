/* The force of a rough surface: how strongly each layer of a texture squeezes the dent, and readings
   of a table at places that move. */
#include "core.h"

#include <math.h>

/* Numbers that weights follow from, as struck.excitation.scraping_force.Reader puts them. */
enum { MODULUS, RADIUS, SHARE, EXPONENT, SPARED, VARIANCE, LIGHTEST, FLOOR, FAINT, FIRST, STEP };

/* The weights (looks, layers) of texture layers under speeds and loads (looks,).

   A layer has heights[l], m, as far as the tip does not follow; log(spacing) is scales[l], and it
   falls silent by falls[l] s/m with speed. shares (knots,): of a layer that a contact feels, from
   the logarithm laws[FIRST] of its radius in spacings on, in steps of laws[STEP]. */
ENTRY void friction_weigh(const double *heights, const double *scales, const double *falls,
                          int64_t layers, const double *shares, int64_t knots,
                          const double *speeds, const double *loads, int64_t looks,
                          const double *laws, double *restrict out) {
  for (int64_t look = 0; look < looks; look++) {
    double *restrict weights = out + look * layers;
    const double load = larger(loads[look], laws[LIGHTEST]), speed = speeds[look];
    const double radius = log(cbrt(3 * load * laws[RADIUS] / (4 * laws[MODULUS])));
    double squares = 0, loudest = 0;
    for (int64_t l = 0; l < layers; l++) {
      const double at = (radius - scales[l] - laws[FIRST]) / laws[STEP];
      const double known = smaller(larger(at, 0), (double)(knots - 1));
      const int64_t low = least((int64_t)known, knots - 2);
      weights[l] = heights[l] * (shares[low] + (known - (double)low) * (shares[low + 1] - shares[low]));
      squares += weights[l] * weights[l];
    }
    const double felt = sqrt(laws[VARIANCE] * squares);
    const double squeeze = cbrt(6 * laws[MODULUS] * laws[MODULUS] * laws[RADIUS] * load) / load;
    const double share = smaller(laws[SHARE] * pow(speed, laws[EXPONENT]), 1);
    const double scale = share * squeeze / (1 + pow(squeeze * felt, laws[SPARED]));
    for (int64_t l = 0; l < layers; l++) {
      const double heard = smaller(larger(laws[FLOOR] - falls[l] * speed, 0), 1);
      weights[l] *= loads[look] > 0 ? heard * scale : 0;
      loudest = larger(loudest, weights[l]);
    }
    for (int64_t l = 0; l < layers; l++)
      if (weights[l] < laws[FAINT] * loudest) weights[l] = 0;
  }
}

/* Readings between two levels of a table, in each of them by the cubic through the four points
   about a place (Lagrange).

   With s = k / samples, at sample k the level is levels[0] + s (levels[1] - levels[0]), the weight
   likewise, and out[k] += weight * value.

   values: periods of all levels, level after level; the one at j has counts[j] points, at least 4,
   from starts[j] on (levels,). turns, out (samples,): places in periods, and what is added to. */

/* The value of one period (count,) at a turn of it. Sums of two values are those of float. */
static double cubic(const float *values, int64_t count, double turn) {
  const double place = (turn - floor(turn)) * (double)count;
  const int64_t whole = place <= (double)count ? (int64_t)place : 0; /* 0: not a number */
  const double x = place - (double)whole;
  const int64_t at = whole == count ? 0 : whole;
  const float before = values[at == 0 ? count - 1 : at - 1], here = values[at];
  const float after = values[at + 1 < count ? at + 1 : at + 1 - count];
  const float beyond = values[at + 2 < count ? at + 2 : at + 2 - count];
  const double slope = after - before / 3.0 - here / 2.0 - beyond / 6.0;
  const double bend = (before + after) / 2.0 - here;
  const double twist = (beyond - before) / 6.0 + (here - after) / 2.0;
  return here + x * (slope + x * (bend + x * twist));
}

ENTRY void friction_add_reading(const float *values, const int64_t *starts, const int64_t *counts,
                                int64_t levels, const double *turns, int64_t samples,
                                double first_level, double last_level, double first_weight,
                                double last_weight, double *restrict out) {
  for (int64_t k = 0; k < samples; k++) {
    const double share = (double)k / (double)samples;
    const double level = (1 - share) * first_level + share * last_level;
    if (!(level < (double)levels)) continue; /* too fast to be heard, or not a number */
    const int64_t low = (int64_t)level;
    const double blend = level - (double)low;
    double value = (1 - blend) * cubic(values + starts[low], counts[low], turns[k]);
    if (low + 1 < levels)
      value += blend * cubic(values + starts[low + 1], counts[low + 1], turns[k]);
    out[k] += ((1 - share) * first_weight + share * last_weight) * value;
  }
}
