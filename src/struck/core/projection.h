/* Shared by the files of the fit: the bins of a group of modes, and vectors along them.

   A vector of K complex bins is kept as K real parts, then K imaginary ones, so that every loop
   over bins is one of real products. Rows of such vectors (M, K) take 2 M K numbers. */
#ifndef STRUCK_PROJECTION_H
#define STRUCK_PROJECTION_H

#include <complex.h>
#include <math.h>

#include "core.h"

#pragma STDC CX_LIMITED_RANGE ON /* products without a second look at infinities */

typedef double _Complex Number;

/* The fields of `GroupBlocks` in projection.py, which tells their shapes; G groups, S segments. */
typedef struct {
  int64_t groups, segments;
  const int64_t *members, *starts, *numbers, *firsts, *offsets;
  const Number *turns, *data;
  const double *lengths, *weights;
  const int64_t *rows;
  double sample_rate;
} Blocks;

#define BLOCKS_GIVEN                                                                          \
  int64_t groups, int64_t segments, const int64_t *members, const int64_t *starts,            \
      const int64_t *numbers, const int64_t *firsts, const int64_t *offsets,                  \
      const Number *turns, const Number *data, const double *lengths, const double *weights,  \
      const int64_t *rows, double sample_rate
#define BLOCKS_OF_GIVEN                                                                       \
  {groups, segments, members, starts,  numbers, firsts,     offsets,                          \
   turns,  data,     lengths, weights, rows,    sample_rate}

/* The bins of one group in one segment, and where they stand in the arrays of all its segments. */
typedef struct {
  int64_t bins, first, last; /* rows of the segment's gains */
  int64_t line, datum;       /* bins, and bins times channels, of the segments before */
  const Number *turns;
  const Number *data; /* (bins, channels) */
  double length;      /* s */
} Part;

/* Go on to a segment, the one after the last; a part of zeros comes before the first. */
static inline void go_on(const Blocks *blocks, int64_t group, int64_t segment, Part *part) {
  const int64_t number = blocks->numbers[group * blocks->segments + segment];
  part->line += part->bins;
  part->datum += part->bins * (part->last - part->first);
  part->bins = blocks->firsts[number + 1] - blocks->firsts[number];
  part->first = blocks->rows[segment];
  part->last = blocks->rows[segment + 1];
  part->turns = blocks->turns + blocks->firsts[number];
  part->data = blocks->data + blocks->offsets[number];
  part->length = blocks->lengths[number];
}

/* Work space, handed out from its beginning; what is taken from a copy is free after the copy. */
typedef struct {
  double *next;
} Work;

static inline double *take(Work *work, int64_t count) {
  double *const taken = work->next;
  work->next += count;
  return taken;
}

static inline Number *take_numbers(Work *work, int64_t count) {
  return (Number *)take(work, 2 * count);
}

/* Least-squares fit of M modes to a group's bins; the arrays hold those of all S segments. */
typedef struct {
  double *lines;     /* rows (M, K) of each segment, spectra of the modes without r */
  double *basis;     /* rows (M, K) of each segment, their orthonormal factors */
  double *left;      /* rows (C, K) of each segment, residual of the data */
  Number *triangles; /* (S, M, M), triangular factors */
  Number *residues;  /* (M, C), least-squares factors r of the lines */
} Projection;

static inline Number number(double real, double imaginary) {
  return __builtin_complex(real, imaginary);
}

static inline double square(Number value) {
  return creal(value) * creal(value) + cimag(value) * cimag(value);
}

/* exp(s) */
static inline Number exponential(Number s) {
  const double size = exp(creal(s));
  return number(size * cos(cimag(s)), size * sin(cimag(s)));
}

/* (1 - z^N) / 2i, the ratio of residue to gain; beside 1, what is 350 dB lower is nothing. */
static inline Number span(Number pole, double length) {
  if (creal(pole) * length < -40) return number(0, -0.5);
  const Number whole = exponential(pole * length);
  return number(-0.5 * cimag(whole), 0.5 * creal(whole) - 0.5);
}

static inline Number inverse(Number value) { return conj(value) / square(value); }

/* Sum of conj(left) right over the bins. */
static inline Number inner(int64_t bins, const double *left, const double *right) {
  const double *const below = left + bins, *const beside = right + bins;
  double real = 0, imaginary = 0;
  VECTORS
  for (int64_t k = 0; k < bins; k++) {
    real += left[k] * right[k] + below[k] * beside[k];
    imaginary += left[k] * beside[k] - below[k] * right[k];
  }
  return number(real, imaginary);
}

/* Sum of squared sizes. */
static inline double energy(int64_t bins, const double *vector) {
  double total = 0;
  VECTORS
  for (int64_t k = 0; k < 2 * bins; k++) total += vector[k] * vector[k];
  return total;
}

/* Subtract a multiple of a direction. */
static inline void take_off(int64_t bins, double *restrict vector, Number factor,
                            const double *restrict direction) {
  const double real = creal(factor), imaginary = cimag(factor);
  VECTORS
  for (int64_t k = 0; k < bins; k++) {
    vector[k] -= real * direction[k] - imaginary * direction[bins + k];
    vector[bins + k] -= real * direction[bins + k] + imaginary * direction[k];
  }
}

/* Subtract what orthonormal rows (M, K) explain. */
static inline void take_off_all(int64_t bins, double *vector, int64_t modes, const double *basis) {
  for (int64_t m = 0; m < modes; m++)
    take_off(bins, vector, inner(bins, basis + 2 * m * bins, vector), basis + 2 * m * bins);
}

/* Derivative of a line by its pole, (line^2 - line) / rate. */
static inline void write_slope(int64_t bins, const double *restrict line, double rate,
                               double *restrict slope) {
  const double *const beside = line + bins, over = 1 / rate;
  VECTORS
  for (int64_t k = 0; k < bins; k++) {
    slope[k] = (line[k] * line[k] - beside[k] * beside[k] - line[k]) * over;
    slope[bins + k] = (2 * line[k] * beside[k] - beside[k]) * over;
  }
}

/* projection.c */
Projection empty_projection(const Blocks *blocks, int64_t group, int64_t modes, Work *work);
double *empty_data(const Blocks *blocks, int64_t group, Work *work);
void write_ratios(int64_t modes, const Number *poles, double rate, Number *ratios);
void write_lines(const Part *part, int64_t modes, const Number *poles, double rate, double *lines);
void orthonormalise(int64_t modes, int64_t bins, const double *vectors, double *basis,
                    Number *triangle);
void inverse_spreads(int64_t modes, const Number *triangle, double *spreads, Work work);
void solve_damped(int64_t modes, const Number *matrix, double damping, const Number *side,
                  Number *solved, Work work);
double project(const Blocks *blocks, int64_t group, const double *data, int64_t modes,
               const Number *poles, const Projection *made);
double misfit(const Blocks *blocks, int64_t group, int64_t modes, double cost);
void clear_data(const Blocks *blocks, int64_t group, int64_t modes, const Number *poles,
                const Number *ratios, const Number *gains, double *data, Work work);

/* poles.c */
void normal_equations(const Blocks *blocks, int64_t group, int64_t modes, const Projection *made,
                      Number *matrix, Number *side, Work work);

#endif
