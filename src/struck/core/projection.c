/* Variable projection: the bins of a group of modes split into their fit and a residual.

   A mode that rings from the first of N samples on has the transform r / (1 - z / u) at
   u = exp(2 pi i k / N), exactly: z = exp(s / rate) and r = g (1 - z^N) / 2i. Its conjugate belongs
   to it, for samples are real. The lines 1 / (1 - z / u) of M modes at K bins are made orthonormal;
   what is left of C channels of data beside them is the residual. */
#include "projection.h"

#define CANCELLED 0.1    /* share left from which no second turn is needed */
#define DEPENDENT 1e-14  /* least independent share of a vector */
#define LEAST 1e-300     /* least divisor */
#define CHANCE 3.0       /* standard deviations of the mean energy that a bin of noise leaves */

/* Bins of a group in all segments, or bins times channels. */
static int64_t bins_of(const Blocks *blocks, int64_t group, const int64_t *bounds) {
  int64_t total = 0;
  for (int64_t segment = 0; segment < blocks->segments; segment++) {
    const int64_t number = blocks->numbers[group * blocks->segments + segment];
    total += bounds[number + 1] - bounds[number];
  }
  return total;
}

/* Space for rows (C, K) of each segment. */
double *empty_data(const Blocks *blocks, int64_t group, Work *work) {
  return take(work, 2 * bins_of(blocks, group, blocks->offsets));
}

Projection empty_projection(const Blocks *blocks, int64_t group, int64_t modes, Work *work) {
  const int64_t bins = bins_of(blocks, group, blocks->firsts);
  return (Projection){
      .lines = take(work, 2 * modes * bins),
      .basis = take(work, 2 * modes * bins),
      .left = empty_data(blocks, group, work),
      .triangles = take_numbers(work, blocks->segments * modes * modes),
      .residues = take_numbers(work, modes * blocks->rows[blocks->segments]),
  };
}

/* 1 / (1 - z / u) */
static void write_line(const Part *part, Number ratio, double *restrict line) {
  const double *const turns = (const double *)part->turns;
  const double real = creal(ratio), imaginary = cimag(ratio);
  const int64_t bins = part->bins;
  VECTORS
  for (int64_t k = 0; k < bins; k++) {
    const double a = 1 - (turns[2 * k] * real - turns[2 * k + 1] * imaginary);
    const double b = turns[2 * k] * imaginary + turns[2 * k + 1] * real;
    const double over = 1 / (a * a + b * b);
    line[k] = a * over;
    line[bins + k] = b * over;
  }
}

/* exp(s / rate) of poles (M,). */
void write_ratios(int64_t modes, const Number *poles, double rate, Number *ratios) {
  for (int64_t m = 0; m < modes; m++) ratios[m] = exponential(poles[m] / rate);
}

/* Lines of modes, rows (M, K). */
void write_lines(const Part *part, int64_t modes, const Number *poles, double rate, double *lines) {
  for (int64_t m = 0; m < modes; m++)
    write_line(part, exponential(poles[m] / rate), lines + 2 * m * part->bins);
}

/* QR factors of vectors (M, K), never singular, by Gram and Schmidt; a vector that all but cancels
   takes a second turn, which is enough (Daniel, Gragg, Kaufman and Stewart 1976). */
void orthonormalise(int64_t modes, int64_t bins, const double *restrict vectors,
                    double *restrict basis, Number *restrict triangle) {
  for (int64_t j = 0; j < modes; j++) {
    double *const own = basis + 2 * j * bins;
    for (int64_t k = 0; k < 2 * bins; k++) own[k] = vectors[2 * j * bins + k];
    for (int64_t i = 0; i < modes; i++) triangle[i * modes + j] = 0;
    const double whole = sqrt(energy(bins, own));
    double before, after = whole;
    for (int turn = 0; turn < 2; turn++) {
      before = after;
      for (int64_t i = 0; i < j; i++) {
        const Number part = inner(bins, basis + 2 * i * bins, own);
        triangle[i * modes + j] += part;
        take_off(bins, own, part, basis + 2 * i * bins);
      }
      after = sqrt(energy(bins, own));
      if (after > CANCELLED * before) break;
    }
    const double size = larger(larger(after, DEPENDENT * whole), LEAST);
    triangle[j * modes + j] = size;
    for (int64_t k = 0; k < 2 * bins; k++) own[k] /= size;
  }
}

/* Replace sides (M, count), rows of them `stride` apart, by the solutions of an upper triangular
   system. */
static void solve_triangle(int64_t modes, const Number *restrict triangle, int64_t count,
                           int64_t stride, Number *restrict sides) {
  for (int64_t i = modes - 1; i >= 0; i--) {
    const double over = 1 / creal(triangle[i * modes + i]);
    for (int64_t j = i + 1; j < modes; j++)
      for (int64_t c = 0; c < count; c++)
        sides[i * stride + c] -= triangle[i * modes + j] * sides[j * stride + c];
    for (int64_t c = 0; c < count; c++) sides[i * stride + c] *= over;
  }
}

/* Diagonal (M,) of the inverse Gram matrix, from the factor of QR. */
void inverse_spreads(int64_t modes, const Number *triangle, double *spreads, Work work) {
  Number *const solved = take_numbers(&work, modes * modes);
  for (int64_t i = 0; i < modes * modes; i++) solved[i] = 0;
  for (int64_t i = 0; i < modes; i++) solved[i * modes + i] = 1;
  solve_triangle(modes, triangle, modes, modes, solved);
  for (int64_t i = 0; i < modes; i++) spreads[i] = energy(modes, (double *)(solved + i * modes));
}

/* Solve a Hermitian system with its diagonal raised by a share, by Cholesky's L L^H. */
void solve_damped(int64_t modes, const Number *matrix, double damping, const Number *side,
                  Number *restrict solved, Work work) {
  Number *const factor = take_numbers(&work, modes * modes);
  for (int64_t i = 0; i < modes; i++) {
    Number *const row = factor + i * modes;
    solved[i] = side[i];
    for (int64_t j = 0; j <= i; j++) {
      const Number *const other = factor + j * modes;
      Number total = matrix[i * modes + j] * (i == j ? 1 + damping : 1.0);
      for (int64_t k = 0; k < j; k++) total -= row[k] * conj(other[k]);
      row[j] = i == j ? sqrt(larger(creal(total), LEAST)) : total / creal(other[j]);
    }
    for (int64_t k = 0; k < i; k++) solved[i] -= row[k] * solved[k];
    solved[i] /= creal(row[i]);
  }
  for (int64_t i = modes - 1; i >= 0; i--) {
    for (int64_t k = i + 1; k < modes; k++) solved[i] -= conj(factor[k * modes + i]) * solved[k];
    solved[i] /= creal(factor[i * modes + i]);
  }
}

/* Fit the lines of poles to a group's cleared data; return the residual over a bin's noise. */
double project(const Blocks *blocks, int64_t group, const double *data, int64_t modes,
               const Number *poles, const Projection *made) {
  const int64_t channels = blocks->rows[blocks->segments];
  double cost = 0;
  Part part = {0};
  for (int64_t segment = 0; segment < blocks->segments; segment++) {
    go_on(blocks, group, segment, &part);
    const int64_t bins = part.bins;
    double *const lines = made->lines + 2 * modes * part.line;
    double *const basis = made->basis + 2 * modes * part.line;
    Number *const triangle = made->triangles + segment * modes * modes;
    write_lines(&part, modes, poles, blocks->sample_rate, lines);
    orthonormalise(modes, bins, lines, basis, triangle);
    for (int64_t row = part.first; row < part.last; row++) {
      const int64_t place = 2 * (part.datum + (row - part.first) * bins);
      double *const left = made->left + place;
      for (int64_t k = 0; k < 2 * bins; k++) left[k] = data[place + k];
      for (int64_t m = 0; m < modes; m++) {
        const Number along = inner(bins, basis + 2 * m * bins, left);
        made->residues[m * channels + row] = along;
        take_off(bins, left, along, basis + 2 * m * bins);
      }
      cost += blocks->weights[row * blocks->groups + group] * energy(bins, left);
    }
    const int64_t own = part.last - part.first;
    solve_triangle(modes, triangle, own, channels, made->residues + part.first);
  }
  return cost;
}

/* Residual of a bin and channel, noise being 1; 1 where chance may explain it. */
double misfit(const Blocks *blocks, int64_t group, int64_t modes, double cost) {
  const int64_t unknowns = modes * (blocks->rows[blocks->segments] + 1);
  const double values = most(bins_of(blocks, group, blocks->offsets) - unknowns, 1);
  const double left = cost / values;
  return left > 1 + CHANCE / sqrt(values) ? left : 1;
}

/* Data (bins, channels) of a part as rows (C, K). */
static void read_data(const Part *part, double *restrict rows) {
  const int64_t channels = part->last - part->first, bins = part->bins;
  for (int64_t k = 0; k < bins; k++)
    for (int64_t c = 0; c < channels; c++) {
      rows[2 * c * bins + k] = creal(part->data[k * channels + c]);
      rows[(2 * c + 1) * bins + k] = cimag(part->data[k * channels + c]);
    }
}

/* Add a mode with its conjugate: r / (1 - z / u) and its conjugate's line over one denominator,
   sums of real products. Sums are 4 rows of bins a channel: the real and minus the imaginary part
   of what is still to be turned by conj(1 / u), then of what is not. */
static void add_other(const Part *part, Number pole, Number ratio, const Number *gains,
                      int64_t stride, double *restrict shape, double *restrict sums) {
  const double *const turns = (const double *)part->turns;
  const Number over = 2 * span(pole, part->length);
  const double more = 1 + square(ratio), less = 1 - square(ratio), twice = 2 * creal(ratio);
  const int64_t bins = part->bins;
  VECTORS
  for (int64_t k = 0; k < bins; k++) {
    const double a = more * turns[2 * k] - twice, b = -less * turns[2 * k + 1];
    const double share = 1 / (a * a + b * b);
    shape[k] = a * share;
    shape[bins + k] = b * share;
  }
  for (int64_t row = part->first; row < part->last; row++) {
    const Number residue = gains[row * stride] * over;
    const double turned = creal(residue), still = creal(residue * conj(ratio));
    double *const own = sums + 4 * (row - part->first) * bins;
    VECTORS
    for (int64_t k = 0; k < 2 * bins; k++) {
      own[k] += turned * shape[k];
      own[2 * bins + k] += still * shape[k];
    }
  }
}

/* Subtract what `add_other` summed from one channel's bins. */
static void take_off_others(const Part *part, const double *restrict sums, double *restrict data) {
  const double *const turns = (const double *)part->turns;
  const int64_t bins = part->bins;
  VECTORS
  for (int64_t k = 0; k < bins; k++) {
    const double real = turns[2 * k], imaginary = turns[2 * k + 1];
    const double a = sums[k], b = sums[bins + k];
    data[k] -= real * a - imaginary * b - sums[2 * bins + k];
    data[bins + k] += real * b + imaginary * a - sums[3 * bins + k];
  }
}

/* Write the data of a group, rows (C, K) of each segment, less all other modes and less the spectra
   of its own conjugate poles at positive frequencies; ratios are exp(s / rate) of all poles. */
void clear_data(const Blocks *blocks, int64_t group, int64_t modes, const Number *poles,
                const Number *ratios, const Number *gains, double *data, Work work) {
  const int64_t *const members = blocks->members + blocks->starts[group];
  const int64_t count = blocks->starts[group + 1] - blocks->starts[group];
  Part part = {0};
  for (int64_t segment = 0; segment < blocks->segments; segment++) {
    go_on(blocks, group, segment, &part);
    const int64_t bins = part.bins, channels = part.last - part.first;
    Work own = work;
    double *const rows = data + 2 * part.datum, *const shape = take(&own, 2 * bins);
    double *const sums = take(&own, 4 * bins * channels);
    for (int64_t k = 0; k < 4 * bins * channels; k++) sums[k] = 0;
    read_data(&part, rows);
    for (int64_t mode = 0; mode < modes; mode++) {
      int64_t m = 0;
      while (m < count && members[m] != mode) m++;
      if (m == count)
        add_other(&part, poles[mode], ratios[mode], gains + mode, modes, shape, sums);
    }
    for (int64_t c = 0; c < channels; c++)
      take_off_others(&part, sums + 4 * c * bins, rows + 2 * c * bins);
    for (int64_t m = 0; m < count; m++) {
      const Number pole = poles[members[m]], over = span(pole, part.length);
      write_line(&part, conj(ratios[members[m]]), shape);
      for (int64_t c = 0; c < channels; c++) {
        const Number gain = gains[(part.first + c) * modes + members[m]];
        take_off(bins, rows + 2 * c * bins, conj(gain * over), shape);
      }
    }
  }
}
