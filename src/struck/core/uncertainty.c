/* Cramer-Rao variances of fitted poles and gains, and signs of unresolved pairs.

   The variances of a group's poles are the diagonal of the inverse of their normal matrix, gains
   eliminated; those of its gains, of the inverse Gram matrix of the lines. Where the fit leaves
   more than noise, the residual takes the noise's place. A pair in the place of one mode shows in
   the residual along the line's second derivative, less what lines and first derivatives explain.
   */
#include "projection.h"

#define REGULAR 1e-13 /* share by which the matrix's diagonal is raised */
#define LEAST 1e-300  /* least divisor */

/* Write the diagonal of the inverse of a Hermitian matrix, scaled to a diagonal of ones. */
static void inverse_diagonal(int64_t modes, const Number *matrix, double *diagonal, Work work) {
  double *const scale = take(&work, modes);
  Number *const scaled = take_numbers(&work, modes * modes);
  Number *const unit = take_numbers(&work, modes), *const solved = take_numbers(&work, modes);
  for (int64_t i = 0; i < modes; i++) {
    scale[i] = 1 / sqrt(larger(creal(matrix[i * modes + i]), LEAST));
    unit[i] = 0;
  }
  for (int64_t i = 0; i < modes; i++)
    for (int64_t j = 0; j < modes; j++)
      scaled[i * modes + j] = matrix[i * modes + j] * (scale[i] * scale[j]);
  for (int64_t i = 0; i < modes; i++) {
    unit[i] = 1;
    solve_damped(modes, scaled, REGULAR, unit, solved, work);
    diagonal[i] = creal(solved[i]) * scale[i] * scale[i];
    unit[i] = 0;
  }
}

/* Write the variances of the gains' sizes, (C, M) of all modes. */
static void write_gain_variances(const Blocks *blocks, int64_t group, int64_t modes, double over,
                                 const Number *poles, const Projection *made, double *sizes,
                                 Work work) {
  const int64_t *const members = blocks->members + blocks->starts[group];
  const int64_t count = blocks->starts[group + 1] - blocks->starts[group];
  double *const spreads = take(&work, count);
  Part part = {0};
  for (int64_t segment = 0; segment < blocks->segments; segment++) {
    go_on(blocks, group, segment, &part);
    inverse_spreads(count, made->triangles + segment * count * count, spreads, work);
    for (int64_t m = 0; m < count; m++) {
      const double factor = over * spreads[m] / square(span(poles[members[m]], part.length));
      for (int64_t row = part.first; row < part.last; row++)
        sizes[row * modes + members[m]] = factor / blocks->weights[row * blocks->groups + group];
    }
  }
}

/* Second derivatives of lines (M, K) less their fit by lines and first derivatives. */
static void write_curvatures(int64_t count, int64_t bins, const double *lines, const double *basis,
                             double rate, double *shapes, Work work) {
  double *const known = take(&work, 4 * count * bins), *const slopes = known + 2 * count * bins;
  double *const directions = take(&work, 4 * count * bins);
  Number *const triangle = take_numbers(&work, 4 * count * count);
  for (int64_t k = 0; k < 2 * count * bins; k++) known[k] = basis[k];
  for (int64_t m = 0; m < count; m++) {
    const double *const line = lines + 2 * m * bins, *const beside = line + bins;
    double *const slope = slopes + 2 * m * bins, *const shape = shapes + 2 * m * bins;
    write_slope(bins, line, rate, slope);
    for (int64_t k = 0; k < bins; k++) {
      const double real = 2 * line[k] - 1, imaginary = 2 * beside[k];
      shape[k] = (real * slope[k] - imaginary * slope[bins + k]) / rate;
      shape[bins + k] = (real * slope[bins + k] + imaginary * slope[k]) / rate;
    }
  }
  orthonormalise(2 * count, bins, known, directions, triangle);
  for (int64_t m = 0; m < count; m++)
    take_off_all(bins, shapes + 2 * m * bins, 2 * count, directions);
}

/* Add the residual's energies along the second derivatives, and its products with the modes. */
static void add_curvatures(const Blocks *blocks, int64_t group, const Projection *made,
                           double *energies, Number *crossed, double *whole, Work work) {
  const int64_t *const members = blocks->members + blocks->starts[group];
  const int64_t count = blocks->starts[group + 1] - blocks->starts[group];
  const int64_t channels = blocks->rows[blocks->segments];
  Part part = {0};
  for (int64_t segment = 0; segment < blocks->segments; segment++) {
    go_on(blocks, group, segment, &part);
    const int64_t bins = part.bins, begin = 2 * count * part.line;
    Work own = work;
    double *const shapes = take(&own, 2 * count * bins);
    write_curvatures(count, bins, made->lines + begin, made->basis + begin, blocks->sample_rate,
                     shapes, own);
    for (int64_t m = 0; m < count; m++) {
      const double *const shape = shapes + 2 * m * bins;
      const double over = 1 / larger(energy(bins, shape), LEAST);
      for (int64_t row = part.first; row < part.last; row++) {
        const double *const left = made->left + 2 * (part.datum + (row - part.first) * bins);
        const double weight = blocks->weights[row * blocks->groups + group];
        const Number along = inner(bins, shape, left);
        const Number residue = made->residues[m * channels + row];
        energies[members[m]] += square(along) * weight * over;
        crossed[members[m]] += conj(residue) * along * (weight * over);
        whole[members[m]] += square(residue) * weight;
      }
    }
  }
}

/* Write the fields of `PoleStatistics` of all modes; the last three begin as zeros. The work space
   is that of poles.c. */
ENTRY void uncertainty_write_statistics(BLOCKS_GIVEN, int64_t modes, const Number *poles,
                                        const Number *gains, double *variances, double *sizes,
                                        double *energies, Number *crossed, double *whole,
                                        double *space) {
  const Blocks blocks = BLOCKS_OF_GIVEN;
  Number *const ratios = (Number *)space;
  write_ratios(modes, poles, sample_rate, ratios);
  for (int64_t group = 0; group < groups; group++) {
    const int64_t *const some = members + starts[group];
    const int64_t count = starts[group + 1] - starts[group];
    Work work = {space + 2 * modes};
    double *const cleared = empty_data(&blocks, group, &work);
    clear_data(&blocks, group, modes, poles, ratios, gains, cleared, work);
    const Projection made = empty_projection(&blocks, group, count, &work);
    Number *const own = take_numbers(&work, count), *const side = take_numbers(&work, count);
    Number *const matrix = take_numbers(&work, count * count);
    double *const diagonal = take(&work, count);
    for (int64_t m = 0; m < count; m++) own[m] = poles[some[m]];
    const double cost = project(&blocks, group, cleared, count, own, &made);
    const double over = misfit(&blocks, group, count, cost);
    normal_equations(&blocks, group, count, &made, matrix, side, work);
    inverse_diagonal(count, matrix, diagonal, work);
    write_gain_variances(&blocks, group, modes, over, poles, &made, sizes, work);
    add_curvatures(&blocks, group, &made, energies, crossed, whole, work);
    for (int64_t m = 0; m < count; m++) {
      variances[some[m]] = over * diagonal[m];
      energies[some[m]] /= over;
    }
  }
}
