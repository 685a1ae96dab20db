/* Levenberg-Marquardt steps of the poles of each group, gains eliminated, and what each mode alone
   explains.

   The matrix (M, M) and right side (M,) of a step are those of variable projection with Kaufman's
   derivative: the slopes of the lines, less what the lines themselves explain of them, times the
   residues. Summed over the channels this is an elementwise product, so their number costs next to
   nothing. The work space must hold 10 D + (20 M + 4) B + (4 S + 16) M^2 + 4 M C + 16 M numbers, of
   the group with most modes M, bins B of all S segments, and bins times channels D; and 2 numbers
   for each mode of all groups. */
#include "projection.h"

/* As in normal_equations.py. */
#define SLOWEST 0.02   /* least decay rate, 1/s */
#define FASTEST 1500.0 /* largest decay rate, 1/s */
#define LEAST_Q 0.25   /* least pi f / d */
#define SETTLED 1e-3   /* least gain of a step in units of the noise's cost */
#define TRIES 4        /* steps without success */

static void add_equations(const Part *part, int64_t modes, const double *slopes, const double *left,
                          const Number *residues, int64_t channels, const double *weights,
                          int64_t stride, Number *matrix, Number *side) {
  const int64_t bins = part->bins;
  for (int64_t i = 0; i < modes; i++) {
    const double *const slope = slopes + 2 * i * bins;
    for (int64_t row = part->first; row < part->last; row++)
      side[i] += conj(residues[i * channels + row]) * weights[row * stride] *
                 inner(bins, slope, left + 2 * (row - part->first) * bins);
    for (int64_t j = 0; j <= i; j++) {
      Number shared = 0;
      for (int64_t row = part->first; row < part->last; row++)
        shared += conj(residues[i * channels + row]) * weights[row * stride] *
                  residues[j * channels + row];
      const Number product = inner(bins, slope, slopes + 2 * j * bins) * shared;
      matrix[i * modes + j] += product;
      if (i != j) matrix[j * modes + i] += conj(product);
    }
  }
}

void normal_equations(const Blocks *blocks, int64_t group, int64_t modes, const Projection *made,
                      Number *matrix, Number *side, Work work) {
  for (int64_t i = 0; i < modes * modes; i++) matrix[i] = 0;
  for (int64_t i = 0; i < modes; i++) side[i] = 0;
  Part part = {0};
  for (int64_t segment = 0; segment < blocks->segments; segment++) {
    go_on(blocks, group, segment, &part);
    const double *const lines = made->lines + 2 * modes * part.line;
    const double *const basis = made->basis + 2 * modes * part.line;
    Work own = work;
    double *const slopes = take(&own, 2 * modes * part.bins);
    for (int64_t m = 0; m < modes; m++) {
      double *const slope = slopes + 2 * m * part.bins;
      write_slope(part.bins, lines + 2 * m * part.bins, blocks->sample_rate, slope);
      take_off_all(part.bins, slope, modes, basis);
    }
    add_equations(&part, modes, slopes, made->left + 2 * part.datum, made->residues,
                  blocks->rows[blocks->segments], blocks->weights + group, blocks->groups, matrix,
                  side);
  }
}

/* A pole with its decay rate bounded by what can be told from a click and from a tone. */
static Number damped(Number pole) {
  const double slow = larger(fabs(cimag(pole)) / (2 * LEAST_Q), 2 * SLOWEST);
  return number(-smaller(larger(-creal(pole), SLOWEST), smaller(FASTEST, slow)), cimag(pole));
}

/* A step of half a decay rate at most, twice that in angular frequency, and still damped. */
static Number stepped(Number pole, Number step) {
  const double far = larger(-0.5 * creal(pole), 2);
  const double real = smaller(larger(creal(step), -far), far);
  const double imaginary = smaller(larger(cimag(step), -2 * far), 2 * far);
  return damped(pole + number(real, imaginary));
}

/* Refine one group's poles (M,) in their place; return their residual, and their fit in `here`. */
static double settle(const Blocks *blocks, int64_t group, const double *data, int64_t modes,
                     Number *poles, int64_t steps, Projection *here, Work work) {
  Projection there = empty_projection(blocks, group, modes, &work);
  Number *const matrix = take_numbers(&work, modes * modes);
  Number *const side = take_numbers(&work, modes), *const step = take_numbers(&work, modes);
  Number *const moved = take_numbers(&work, modes);
  double cost = NAN, damping = 5e-3; /* nothing is too much at first */
  int64_t taken = 0, tries = 0;
  for (int64_t m = 0; m < modes; m++) moved[m] = poles[m];
  while (tries < TRIES) {
    const double lower = project(blocks, group, data, modes, moved, &there);
    if (!(lower >= cost)) {
      const Projection before = *here;
      *here = there;
      there = before;
      cost = lower;
      for (int64_t m = 0; m < modes; m++) poles[m] = moved[m];
      if (taken == steps) break;
      normal_equations(blocks, group, modes, here, matrix, side, work);
      damping = larger(damping / 5, 1e-9);
      taken++;
      tries = 0;
    } else {
      damping *= 8;
      tries++;
    }
    solve_damped(modes, matrix, damping, side, step, work);
    double gain = 0;
    for (int64_t m = 0; m < modes; m++) gain += creal(conj(side[m]) * step[m]);
    if (!(gain > SETTLED)) break;
    for (int64_t m = 0; m < modes; m++) moved[m] = stepped(poles[m], step[m]);
  }
  return cost;
}

/* Write the gains of a group's modes, columns of own (C, count). */
static void write_gains(const Blocks *blocks, int64_t group, int64_t modes, const Number *poles,
                        const Projection *made, int64_t count, Number *own) {
  const int64_t channels = blocks->rows[blocks->segments];
  Part part = {0};
  for (int64_t segment = 0; segment < blocks->segments; segment++) {
    go_on(blocks, group, segment, &part);
    for (int64_t m = 0; m < modes; m++) {
      const Number over = inverse(span(poles[m], part.length));
      for (int64_t row = part.first; row < part.last; row++)
        own[row * count + m] = made->residues[m * channels + row] * over;
    }
  }
}

/* Refine poles moved (N,) in the place of each group's, of which `begins` (G + 1,) tells where they
   begin, against the data without all other modes, poles (M,) and gains (C, M). With `keep` those
   become the group's before the next one's turn. Writes gains own (C, N), costs and misfits (G,).
   */
ENTRY void poles_take_turns(BLOCKS_GIVEN, int64_t modes, Number *poles, Number *gains,
                            const int64_t *begins, int64_t steps, int64_t keep, Number *moved,
                            Number *own, double *costs, double *misfits, double *space) {
  const Blocks blocks = BLOCKS_OF_GIVEN;
  const int64_t channels = rows[segments], all = begins[groups];
  Number *const ratios = (Number *)space;
  write_ratios(modes, poles, sample_rate, ratios);
  for (int64_t group = 0; group < groups; group++) {
    Work work = {space + 2 * modes};
    const int64_t first = begins[group], count = begins[group + 1] - first;
    Number *const found = moved + first;
    double *const cleared = empty_data(&blocks, group, &work);
    clear_data(&blocks, group, modes, poles, ratios, gains, cleared, work);
    Projection here = empty_projection(&blocks, group, count, &work);
    costs[group] = settle(&blocks, group, cleared, count, found, steps, &here, work);
    misfits[group] = misfit(&blocks, group, count, costs[group]);
    write_gains(&blocks, group, count, found, &here, all, own + first);
    for (int64_t m = 0; keep && m < count; m++) {
      const int64_t mode = members[first + m];
      poles[mode] = found[m];
      write_ratios(1, found + m, sample_rate, ratios + mode);
      for (int64_t row = 0; row < channels; row++)
        gains[row * modes + mode] = own[row * all + first + m];
    }
  }
}

/* Add the energies (M,) that only one mode explains, and write the largest share of its energy. */
ENTRY void poles_add_unique(BLOCKS_GIVEN, int64_t modes, const Number *poles, const Number *gains,
                            double *energies, double *shares, double *space) {
  const Blocks blocks = BLOCKS_OF_GIVEN;
  for (int64_t group = 0; group < groups; group++) {
    const int64_t *const some = members + starts[group];
    const int64_t count = starts[group + 1] - starts[group];
    Part part = {0};
    for (int64_t segment = 0; segment < segments; segment++) {
      go_on(&blocks, group, segment, &part);
      Work work = {space};
      Number *const own = take_numbers(&work, count);
      Number *const triangle = take_numbers(&work, count * count);
      double *const spreads = take(&work, count), *const lines = take(&work, 2 * count * part.bins);
      double *const basis = take(&work, 2 * count * part.bins);
      for (int64_t m = 0; m < count; m++) own[m] = poles[some[m]];
      write_lines(&part, count, own, sample_rate, lines);
      orthonormalise(count, part.bins, lines, basis, triangle);
      inverse_spreads(count, triangle, spreads, work);
      for (int64_t m = 0; m < count; m++) {
        const double size = square(span(own[m], part.length)) / spreads[m];
        for (int64_t row = part.first; row < part.last; row++)
          energies[some[m]] +=
              size * square(gains[row * modes + some[m]]) * weights[row * groups + group];
        const double alone = spreads[m] * energy(part.bins, lines + 2 * m * part.bins);
        shares[some[m]] = larger(shares[some[m]], 1 / alone);
      }
    }
  }
}
