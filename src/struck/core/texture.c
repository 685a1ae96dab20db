/* A random solid texture: layers of value noise, each read at places that move.

   A layer is a lattice of its own spacing and orientation, with a random value at each corner that
   follows from the corner's three numbers and the layer's seed alone. Between the eight corners of
   a cell values are blended by w(t) = 6 t^5 - 15 t^4 + 10 t^3 along each axis. So a place has its
   value whatever was read before, and no table holds what is read.

   Coordinate j of sample i is places[along i + across j].

   Sample i adds sum over layers of weight * value to out[i]. Weights go in straight lines from one
   row of a table to the next in CHUNK samples, `first` of which are over when this call begins. */
#include "core.h"

#include <math.h>
#include <string.h>

#define CHUNK 64
#define FARTHEST 2e15 /* cell that a place can be told apart in, below 2^51 */
#define FEW 2 /* samples in a cell, on average, from which on they share its corners */

/* A whole number from another, all bits of which depend on all (C. Wellons, "lowbias32"). */
static inline uint32_t mixed(uint32_t x) {
  x ^= x >> 16;
  x *= 0x7feb352du;
  x ^= x >> 15;
  x *= 0x846ca68bu;
  return x ^ (x >> 16);
}

/* Random values of variance 1 at the eight corners of cells, the last axis running fastest.

   A cell is three whole numbers in two's complement. */
static void corners_of(const uint32_t cell[3][CHUNK], int64_t cells, uint32_t seed,
                       double values[8][CHUNK]) {
  const double scale = 2 * sqrt(3.0) / 4294967296.0;
  uint32_t sides[2][CHUNK], edges[4][CHUNK]; /* of one and of two of a corner's numbers */
  for (uint32_t i = 0; i < 2; i++)
    VECTORS for (int64_t k = 0; k < cells; k++) sides[i][k] = mixed(seed + cell[0][k] + i);
  for (uint32_t i = 0; i < 4; i++)
    VECTORS
    for (int64_t k = 0; k < cells; k++) edges[i][k] = mixed(sides[i >> 1][k] + cell[1][k] + (i & 1));
  for (uint32_t i = 0; i < 8; i++)
    VECTORS for (int64_t k = 0; k < cells; k++) {
      const uint32_t corner = mixed(edges[i >> 1][k] + cell[2][k] + (i & 1));
      values[i][k] = (double)(int32_t)(corner ^ 0x80000000u) * scale;
    }
}

static inline double blend(double t) { return t * t * t * (t * (t * 6 - 15) + 10); }

/* The value between the corners of cell k. */
static inline double between(const double v[8][CHUNK], int64_t k, double a, double b, double c) {
  const double v00 = v[0][k] + c * (v[1][k] - v[0][k]), v01 = v[2][k] + c * (v[3][k] - v[2][k]);
  const double v10 = v[4][k] + c * (v[5][k] - v[4][k]), v11 = v[6][k] + c * (v[7][k] - v[6][k]);
  const double v0 = v00 + b * (v01 - v00), v1 = v10 + b * (v11 - v10);
  return v0 + a * (v1 - v0);
}

/* The last 32 bits of a whole number below 2^51, in two's complement. */
static inline uint32_t bits_of(double whole) {
  const double raised = whole + 6755399441055744.0; /* 1.5 * 2^52: its last bit counts ones */
  uint64_t bits;
  memcpy(&bits, &raised, sizeof bits);
  return (uint32_t)bits;
}

/* Add a layer to the first `count` samples of a chunk at[3], weights going from `weight` by
   `slope`. */
static void add_layer(const double *turned, const double *shift, uint32_t seed,
                      const double (*at)[CHUNK], int64_t count, double weight, double slope,
                      double *restrict out) {
  uint32_t cell[3][CHUNK];
  double part[3][CHUNK], known[CHUNK];
  VECTORS for (int64_t i = 0; i < count; i++) known[i] = 1.0;
  for (int axis = 0; axis < 3; axis++) {
    const double *row = turned + 3 * axis;
    VECTORS
    for (int64_t i = 0; i < count; i++) {
      const double place = row[0] * at[0][i] + row[1] * at[1][i] + row[2] * at[2][i] + shift[axis];
      const double below = floor(place);
      /* Farther off a double has no places between whole numbers; nor has what is no number. */
      const double here = fabs(below) < FARTHEST ? 1.0 : 0.0;
      known[i] *= here;
      cell[axis][i] = bits_of(below);
      part[axis][i] = blend(here > 0 ? place - below : 0.0);
    }
  }
  uint32_t entered[CHUNK], entries = 0; /* whether a sample is the first one in its cell */
  VECTORS
  for (int64_t i = 1; i < count; i++) {
    entered[i] = ((cell[0][i] ^ cell[0][i - 1]) | (cell[1][i] ^ cell[1][i - 1]) |
                  (cell[2][i] ^ cell[2][i - 1])) != 0;
    entries += entered[i];
  }
  double corners[8][CHUNK], value[CHUNK];
  if (FEW * entries > count) {
    corners_of(cell, count, seed, corners);
    VECTORS
    for (int64_t i = 0; i < count; i++)
      value[i] = between(corners, i, part[0][i], part[1][i], part[2][i]);
  } else {
    int64_t first[CHUNK + 1] = {0}, cells = 1;
    for (int64_t i = 1; i < count; i++) {
      if (!entered[i]) continue;
      for (int axis = 0; axis < 3; axis++) cell[axis][cells] = cell[axis][i];
      first[cells++] = i;
    }
    first[cells] = count;
    corners_of(cell, cells, seed, corners);
    for (int64_t k = 0; k < cells; k++)
      VECTORS for (int64_t i = first[k]; i < first[k + 1]; i++)
        value[i] = between(corners, k, part[0][i], part[1][i], part[2][i]);
  }
  VECTORS
  for (int64_t i = 0; i < count; i++)
    out[i] += (weight + slope * (double)i) * known[i] * value[i];
}

ENTRY void texture_add_heights(const double *turned, const double *shifts, const int64_t *seeds,
                               int64_t layers, const double *weights, int64_t first,
                               const double *places, int64_t along, int64_t across,
                               int64_t samples, double *restrict out) {
  for (int64_t done = 0; done < samples;) {
    const int64_t begun = (first + done) % CHUNK, row = (first + done) / CHUNK;
    const int64_t count = least(CHUNK - begun, samples - done);
    const double *from = weights + row * layers, *to = from + layers;
    double at[3][CHUNK];
    for (int64_t i = 0; i < count; i++)
      for (int axis = 0; axis < 3; axis++) at[axis][i] = places[along * (done + i) + across * axis];
    for (int64_t layer = 0; layer < layers; layer++) {
      if (from[layer] == 0 && to[layer] == 0) continue; /* too fast to be heard, or flat */
      const double slope = (to[layer] - from[layer]) / CHUNK;
      add_layer(turned + 9 * layer, shifts + 3 * layer, (uint32_t)seeds[layer], at, count,
                from[layer] + slope * (double)(begun + 1), slope, out + done);
    }
    done += count;
  }
}
