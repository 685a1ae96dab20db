/* A random solid texture: layers of value noise, each read at places that move.

   A layer is a lattice of its own spacing and orientation, with a random value at each corner that
   follows from the corner's three numbers and the layer's seed alone. Between the eight corners of
   a cell values are blended by w(t) = 6 t^5 - 15 t^4 + 10 t^3 along each axis. So a place has its
   value whatever was read before, and no table holds what is read.

   Sample i adds sum over layers of weight * value to out[i]. Weights go in straight lines from one
   row of a table to the next in CHUNK samples, `first` of which are over when this call begins. */
#include "core.h"

#include <math.h>

#define CHUNK 64

/* A whole number from another, all bits of which depend on all (C. Wellons, "lowbias32"). */
static inline uint32_t mixed(uint32_t x) {
  x ^= x >> 16;
  x *= 0x7feb352du;
  x ^= x >> 15;
  x *= 0x846ca68bu;
  return x ^ (x >> 16);
}

/* Random values of variance 1 at the eight corners of a cell, the last axis running fastest. */
static void corners_of(const int64_t cell[3], uint32_t seed, double values[8]) {
  const double scale = 2 * sqrt(3.0) / 4294967296.0;
  uint32_t sides[2], edges[4], corners[8]; /* of one, two and three of the corner's numbers */
  for (int i = 0; i < 2; i++) sides[i] = mixed(seed + (uint32_t)(cell[0] + i));
  for (int i = 0; i < 4; i++) edges[i] = mixed(sides[i >> 1] + (uint32_t)(cell[1] + (i & 1)));
  for (int i = 0; i < 8; i++) corners[i] = mixed(edges[i >> 1] + (uint32_t)(cell[2] + (i & 1)));
  for (int i = 0; i < 8; i++) values[i] = (double)corners[i] * scale - sqrt(3.0);
}

static inline double blend(double t) { return t * t * t * (t * (t * 6 - 15) + 10); }

/* Add a layer to the samples [begin, end) of one chunk, weights going from `weight` by `slope`. */
static void add_layer(const double *turned, const double *shift, uint32_t seed,
                      const double *places, int64_t count, double weight, double slope,
                      double *restrict out) {
  double whole[3][CHUNK], part[3][CHUNK];
  for (int axis = 0; axis < 3; axis++) {
    const double *row = turned + 3 * axis;
    VECTORS
    for (int64_t i = 0; i < count; i++) {
      const double *place = places + 3 * i;
      const double at = row[0] * place[0] + row[1] * place[1] + row[2] * place[2] + shift[axis];
      const double below = floor(at);
      whole[axis][i] = below;
      part[axis][i] = blend(at - below);
    }
  }
  for (int64_t begin = 0, end; begin < count; begin = end) {
    const double x = whole[0][begin], y = whole[1][begin], z = whole[2][begin];
    for (end = begin + 1; end < count; end++)
      if (whole[0][end] != x || whole[1][end] != y || whole[2][end] != z) break;
    /* Beyond this a double has no places between whole numbers left; nor has what is no number. */
    if (!(fabs(x) < 4e15 && fabs(y) < 4e15 && fabs(z) < 4e15)) continue;
    const int64_t cell[3] = {(int64_t)x, (int64_t)y, (int64_t)z};
    double v[8];
    corners_of(cell, seed, v);
    VECTORS
    for (int64_t i = begin; i < end; i++) {
      const double a = part[0][i], b = part[1][i], c = part[2][i];
      const double v00 = v[0] + c * (v[1] - v[0]), v01 = v[2] + c * (v[3] - v[2]);
      const double v10 = v[4] + c * (v[5] - v[4]), v11 = v[6] + c * (v[7] - v[6]);
      const double v0 = v00 + b * (v01 - v00), v1 = v10 + b * (v11 - v10);
      out[i] += (weight + slope * (double)i) * (v0 + a * (v1 - v0));
    }
  }
}

/* turned (layers, 3, 3), shifts (layers, 3): from places to the numbers of cells. seeds (layers,).
   weights (rows, layers). places (samples, 3), m. out (samples,). */
ENTRY void texture_add_heights(const double *turned, const double *shifts, const int64_t *seeds,
                               int64_t layers, const double *weights, int64_t first,
                               const double *places, int64_t samples, double *restrict out) {
  for (int64_t done = 0; done < samples;) {
    const int64_t begun = (first + done) % CHUNK, row = (first + done) / CHUNK;
    const int64_t count = least(CHUNK - begun, samples - done);
    const double *from = weights + row * layers, *to = from + layers;
    for (int64_t layer = 0; layer < layers; layer++) {
      if (from[layer] == 0 && to[layer] == 0) continue; /* too fast to be heard, or flat */
      const double slope = (to[layer] - from[layer]) / CHUNK;
      add_layer(turned + 9 * layer, shifts + 3 * layer, (uint32_t)seeds[layer], places + 3 * done,
                count, from[layer] + slope * (double)(begun + 1), slope, out + done);
    }
    done += count;
  }
}
