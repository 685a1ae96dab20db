/* The only loops over samples of modes: a bank of two-pole resonators.

   A mode is c[k] = z c[k-1] + drive F[k] / rate, heard as Im[a c[k]]. With v[k] = Im[z c[k]]:

     v[k] = 2 Re z v[k-1] - |z|^2 v[k-2] + gain F[k],   gain = drive Im z / rate,
     Im[a c[k]] = weight v[k-1] + turned v[k],          turned = Im a / Im z,
                                                        weight = Re a - turned Re z,

   so a real output takes four operations a sample and a complex one five. Under one steady push the
   pair is kept in units of the gain, v / gain: that push then needs no product of its own. A kernel
   takes a frame of several samples and loops over the modes inside, a vector of modes at a time,
   with one sum for each sample and output in registers: a state crosses the nearest cache once a
   frame, and memory once a block. Gains may change linearly from sample to sample. */
#include "bank.h"

#if defined(__AVX512F__)
enum { WIDE = 8 };
#elif defined(__AVX__)
enum { WIDE = 4 };
#else
enum { WIDE = 2 };
#endif
typedef double vector __attribute__((vector_size(8 * WIDE)));
enum { NEARBY = 512 }; /* modes that go through a block together: the nearest cache holds them */

#define UNROLLED _Pragma("clang loop unroll(full)")
#define INLINED static inline __attribute__((always_inline))

INLINED vector loaded(const double *from) { return *(const vector *)from; }

/* Sum of the lanes: halves are added to halves. */
INLINED double total(vector v) {
  double sums[WIDE];
  UNROLLED for (int lane = 0; lane < WIDE; lane++) sums[lane] = v[lane];
  UNROLLED for (int half = WIDE / 2; half; half /= 2)
    UNROLLED for (int lane = 0; lane < half; lane++) sums[lane] += sums[lane + half];
  return sums[0];
}

/* Add the sums of the lanes of some vectors to as many samples. */
INLINED void add_totals(const vector *sums, int samples, double *sound) {
#if defined(__AVX512F__)
  if (samples == 8) { /* neighbours are summed in pairs, then pairs, then fours: all eight at once */
    vector two[4], four[2];
    UNROLLED for (int i = 0; i < 4; i++) {
      const vector a = sums[2 * i], b = sums[2 * i + 1];
      two[i] = __builtin_shufflevector(a, b, 0, 8, 2, 10, 4, 12, 6, 14) +
               __builtin_shufflevector(a, b, 1, 9, 3, 11, 5, 13, 7, 15);
    }
    UNROLLED for (int i = 0; i < 2; i++) {
      const vector a = two[2 * i], b = two[2 * i + 1];
      four[i] = __builtin_shufflevector(a, b, 0, 1, 8, 9, 4, 5, 12, 13) +
                __builtin_shufflevector(a, b, 2, 3, 10, 11, 6, 7, 14, 15);
    }
    const vector eight = __builtin_shufflevector(four[0], four[1], 0, 1, 2, 3, 8, 9, 10, 11) +
                         __builtin_shufflevector(four[0], four[1], 4, 5, 6, 7, 12, 13, 14, 15);
    UNROLLED for (int k = 0; k < 8; k++) sound[k] += eight[k];
    return;
  }
#endif
  UNROLLED for (int k = 0; k < samples; k++) sound[k] += total(sums[k]);
}

/* Samples of a frame: as many sums as registers hold. */
INLINED int frame_of(int pushes, int outputs, int turned, int ramped) {
  const int kept = ramped ? 2 * (pushes + outputs * (turned ? 2 : 1)) : 0;
  for (int samples = 8; samples > 2; samples /= 2)
    if (samples * outputs <= 16 && samples * outputs + kept + samples * pushes / 2 <= 32)
      return samples;
  return 2;
}

/* Gains of one vector of modes, and their steps from sample to sample. */
struct gains {
  vector push[PUSHES], push_step[PUSHES];
  vector weight[OUTPUTS], weight_step[OUTPUTS], turn[OUTPUTS], turn_step[OUTPUTS];
};

INLINED vector begun(const double *gain, const double *slope, int64_t n, int64_t samples) {
  return loaded(gain + n) + loaded(slope + n) * (double)samples;
}

INLINED void read_gains(const struct group *g, struct gains *x, int64_t n, int64_t k, int pushes,
                        int outputs, int turned, int ramped) {
  UNROLLED for (int p = 0; p < pushes; p++) {
    x->push[p] = ramped ? begun(g->gain[p], g->gain_slope[p], n, k) : loaded(g->gain[p] + n);
    if (ramped) x->push_step[p] = loaded(g->gain_slope[p] + n);
  }
  UNROLLED for (int o = 0; o < outputs; o++) {
    x->weight[o] =
        ramped ? begun(g->weight[o], g->weight_slope[o], n, k) : loaded(g->weight[o] + n);
    if (ramped) x->weight_step[o] = loaded(g->weight_slope[o] + n);
    if (!turned) continue;
    x->turn[o] = ramped ? begun(g->turn[o], g->turn_slope[o], n, k) : loaded(g->turn[o] + n);
    if (ramped) x->turn_step[o] = loaded(g->turn_slope[o] + n);
  }
}

INLINED void step_gains(struct gains *x, int pushes, int outputs, int turned) {
  UNROLLED for (int p = 0; p < pushes; p++) x->push[p] += x->push_step[p];
  UNROLLED for (int o = 0; o < outputs; o++) {
    x->weight[o] += x->weight_step[o];
    if (turned) x->turn[o] += x->turn_step[o];
  }
}

/* One frame of the modes from `begin` to `end`; the arguments from `pushes` on are constants where
   it is used. */
INLINED void frame(const struct group *given, int64_t begin, int64_t end, int64_t first, int pushes,
                   int outputs, int turned, int ramped, int unit, int samples) {
#pragma clang fp reassociate(off) /* what the last sample made comes into the next one last */
  const struct group copy = *given, *g = &copy; /* which no store can change: read once */
  vector sums[16] = {0};
  double forces[8 * PUSHES];
  UNROLLED for (int p = 0; p < pushes; p++)
    UNROLLED for (int k = 0; k < samples; k++) forces[p * samples + k] = g->force[p][first + k];
  const double *feedback = g->feedback, *loss = g->loss;
  double *latest = g->latest, *previous = g->previous;
  const int driven = unit ? 0 : pushes;
  for (int64_t n = begin; n < end; n += WIDE) {
    struct gains x;
    read_gains(g, &x, n, first + 1, driven, outputs, turned, ramped);
    const vector p1 = loaded(feedback + n), p2 = loaded(loss + n);
    vector now = loaded(latest + n), past = loaded(previous + n);
    UNROLLED for (int k = 0; k < samples; k++) {
      if (ramped && k) step_gains(&x, driven, outputs, turned);
      UNROLLED for (int o = 0; o < outputs; o++) sums[o * samples + k] += x.weight[o] * now;
      vector next = p2 * past;
      if (unit) next += forces[k];
      UNROLLED for (int p = 0; p < driven; p++) next += x.push[p] * forces[p * samples + k];
      next += p1 * now;
      past = now;
      now = next;
      if (turned)
        UNROLLED for (int o = 0; o < outputs; o++) sums[o * samples + k] += x.turn[o] * now;
    }
    *(vector *)(latest + n) = now;
    *(vector *)(previous + n) = past;
  }
  UNROLLED for (int o = 0; o < outputs; o++)
    add_totals(sums + o * samples, samples, g->sound[o] + first);
}

/* Whole frames of a block; return how many samples they are. */
INLINED int64_t frames(const struct group *g, int pushes, int outputs, int turned, int ramped,
                       int unit) {
  const int samples = frame_of(pushes, outputs, turned, ramped);
  const int64_t made = g->block / samples * samples;
  for (int64_t begin = 0; begin < g->modes; begin += NEARBY) {
    const int64_t end = begin + NEARBY < g->modes ? begin + NEARBY : g->modes;
    for (int64_t first = 0; first < made; first += samples)
      frame(g, begin, end, first, pushes, outputs, turned, ramped, unit, samples);
  }
  return made;
}

/* One kernel for each number of outputs, real or complex, of pushes, steady or moving. */
#define KERNEL(o, t, p, r, u) \
  static int64_t kernel_##o##_##t##_##p##_##r##_##u(const struct group *g) { \
    return frames(g, p, o, t, r, u); \
  }
/* What is left over when a block is no multiple of a frame, sample by sample: steps may be zero. */
#define REMAINDER(o, t) \
  static void remainder_##o##_##t(const struct group *g, int64_t first) { \
    for (; first < g->block; first++) frame(g, 0, g->modes, first, PUSHES, o, t, 1, 0, 1); \
  }
#if defined(__wasm__) /* few kernels, so that the page loads fast: rare cases go as wider ones */
#define PUSHED(o, t) \
  REMAINDER(o, t) \
  KERNEL(o, t, 0, 0, 0) KERNEL(o, t, 1, 1, 0) KERNEL(o, t, 4, 0, 0) KERNEL(o, t, 4, 1, 0) \
  KERNEL(o, t, 1, 0, 1)
#define kernel_1_1_0_1_0 kernel_1_1_1_1_0
#define kernel_1_1_1_0_0 kernel_1_1_4_0_0
#define kernel_1_1_2_0_0 kernel_1_1_4_0_0
#define kernel_1_1_2_1_0 kernel_1_1_4_1_0
#else
#define PUSHED(o, t) \
  REMAINDER(o, t) \
  KERNEL(o, t, 0, 0, 0) KERNEL(o, t, 0, 1, 0) KERNEL(o, t, 1, 0, 0) KERNEL(o, t, 1, 1, 0) \
  KERNEL(o, t, 2, 0, 0) KERNEL(o, t, 2, 1, 0) KERNEL(o, t, 4, 0, 0) KERNEL(o, t, 4, 1, 0) \
  KERNEL(o, t, 1, 0, 1)
#endif
#define LISTED(o, t) \
  {kernel_##o##_##t##_0_0_0, kernel_##o##_##t##_0_1_0, kernel_##o##_##t##_1_0_0, \
   kernel_##o##_##t##_1_1_0, kernel_##o##_##t##_2_0_0, kernel_##o##_##t##_2_1_0, \
   kernel_##o##_##t##_4_0_0, kernel_##o##_##t##_4_1_0, kernel_##o##_##t##_1_0_1}

typedef int64_t kernel(const struct group *g);
typedef void remainder(const struct group *g, int64_t first);
#if defined(__wasm__)
PUSHED(1, 1)
static kernel *const KERNELS[1][2][9] = {{LISTED(1, 1), LISTED(1, 1)}};
static remainder *const REMAINDERS[1][2] = {{remainder_1_1, remainder_1_1}};
#else
PUSHED(1, 0) PUSHED(1, 1) PUSHED(2, 0) PUSHED(2, 1)
PUSHED(4, 0) PUSHED(4, 1) PUSHED(8, 0) PUSHED(8, 1)
static kernel *const KERNELS[4][2][9] = {{LISTED(1, 0), LISTED(1, 1)},
                                         {LISTED(2, 0), LISTED(2, 1)},
                                         {LISTED(4, 0), LISTED(4, 1)},
                                         {LISTED(8, 0), LISTED(8, 1)}};
static remainder *const REMAINDERS[4][2] = {{remainder_1_0, remainder_1_1},
                                            {remainder_2_0, remainder_2_1},
                                            {remainder_4_0, remainder_4_1},
                                            {remainder_8_0, remainder_8_1}};
#endif

void bank_run(const struct group *g) {
  const int outputs = g->outputs == 1 ? 0 : g->outputs == 2 ? 1 : g->outputs == 4 ? 2 : 3;
  const int pushes = g->pushes < 3 ? (int)g->pushes : 3, turned = g->turned != 0;
  const int form = g->unit ? 8 : 2 * pushes + (g->ramped != 0);
  const int64_t made = KERNELS[outputs][turned][form](g);
  if (made < g->block) REMAINDERS[outputs][turned](g, made);
}

int64_t bank_frame(int64_t outputs, int64_t turned) {
  return frame_of(1, (int)outputs, (int)turned, 0);
}
