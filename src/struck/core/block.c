/* One block of all bodies, from their memory alone.

   Between blocks a mode's state is its complex c, exact whatever comes: a body that sleeps or rings
   freely is moved on by powers of z, and one whose frequencies or decays change goes on from the
   same c. Within a block the kernels take it as the pair (Im[z c], Im c), and leave it so while a
   body is pushed. */
#include <math.h>

#include "bank.h"
#include "memory.h"

#define FAINTEST 1e-100 /* stands in for a zero drive gain: states may be divided by it */
#define GONE 1e-200 /* a smaller state is 0: numbers near the least there are cost tenfold */

/* Turn states into the pairs that kernels take. */
static void unpack(const struct memory *m, const int64_t *b) {
  const double *re = mode(m, STATE_RE), *im = mode(m, STATE_IM);
  const double *turn_re = mode(m, TURN_RE), *turn_im = mode(m, TURN_IM);
  double *restrict latest = mode(m, LATEST), *restrict previous = mode(m, PREVIOUS);
  VECTORS for (int64_t n = b[FIRST]; n < b[LAST]; n++) {
    latest[n] = turn_re[n] * im[n] + turn_im[n] * re[n];
    previous[n] = im[n];
  }
}

/* Turn pairs into states, on top of `kept` (0 or 1) times those there are. */
static void pack(const struct memory *m, const int64_t *b, double kept) {
  const double *latest = mode(m, LATEST), *previous = mode(m, PREVIOUS);
  const double *turn = mode(m, TURN_RE), *inverse = mode(m, INVERSE);
  double *restrict re = mode(m, STATE_RE), *restrict im = mode(m, STATE_IM);
  VECTORS for (int64_t n = b[FIRST]; n < b[LAST]; n++) {
    re[n] = kept * re[n] + (latest[n] - turn[n] * previous[n]) * inverse[n];
    im[n] = kept * im[n] + previous[n];
  }
}

/* Convert a body's state to its complex c. */
void block_settle(const struct memory *m, int64_t number) {
  int64_t *b = body(m, number);
  if (b[HELD_AS] == AS_STATE) return;
  if (b[HELD_AS] == AS_UNIT_PAIRS) {
    const double *unit = mode(m, UNIT);
    double *restrict latest = mode(m, LATEST), *restrict previous = mode(m, PREVIOUS);
    VECTORS for (int64_t n = b[FIRST]; n < b[LAST]; n++) {
      latest[n] *= unit[n];
      previous[n] *= unit[n];
    }
  }
  pack(m, b, 0.0);
  b[HELD_AS] = AS_STATE;
}

/* Convert states to pairs in units of a voice's gains, and outputs to fit. */
static void measure(const struct memory *m, int64_t number, int64_t pushing) {
  int64_t *b = body(m, number);
  if (b[HELD_AS] == AS_STATE) unpack(m, b);
  const double *gain = drive(m, GAIN, pushing);
  double *restrict unit = mode(m, UNIT);
  double *restrict latest = mode(m, LATEST), *restrict previous = mode(m, PREVIOUS);
  VECTORS for (int64_t n = b[FIRST]; n < b[LAST]; n++) {
    const double size = gain[n - b[FIRST]];
    unit[n] = fabs(size) > FAINTEST ? size : FAINTEST;
    latest[n] /= unit[n];
    previous[n] /= unit[n];
  }
  for (int64_t row = 0; row < m->rows; row++) {
    const double *weight = output(m, WEIGHT, row), *turned = output(m, TURNED, row);
    double *restrict in_units = output(m, UNIT_WEIGHT, row);
    double *restrict turned_in_units = output(m, UNIT_TURNED, row);
    VECTORS for (int64_t n = b[FIRST]; n < b[LAST]; n++) {
      in_units[n] = weight[n] * unit[n];
      turned_in_units[n] = turned[n] * unit[n];
    }
  }
  b[HELD_AS] = AS_UNIT_PAIRS;
}

/* Compute all that follows from the poles of a body. */
void block_refresh(const struct memory *m, int64_t number) {
  const int64_t *b = body(m, number);
  const double rate = m->level[RATE], block = (double)m->block;
  for (int64_t n = b[FIRST]; n < b[LAST]; n++) {
    const double re = mode(m, LOG_RE)[n], im = mode(m, LOG_IM)[n];
    const double size = exp(re), far = exp(re * block);
    const double turn_re = size * cos(im), turn_im = size * sin(im);
    mode(m, TURN_RE)[n] = turn_re;
    mode(m, TURN_IM)[n] = turn_im;
    mode(m, LEAP_RE)[n] = far * cos(im * block);
    mode(m, LEAP_IM)[n] = far * sin(im * block);
    mode(m, FEEDBACK)[n] = 2 * turn_re;
    mode(m, LOSS)[n] = -exp(2 * re);
    mode(m, INPUT)[n] = turn_im / rate;
    /* Places that only fill up have no pole: nothing comes in there, nothing goes out. Nor where
       one is so small that what is divided by it would not be finite. */
    const int real = turn_im * turn_im > 0;
    const double square = (1 - turn_re) * (1 - turn_re) + turn_im * turn_im;
    mode(m, INVERSE)[n] = real ? 1 / turn_im : 0.0;
    mode(m, HOLD_RE)[n] = real ? (1 - turn_re) / square / rate : 0.0;
    mode(m, HOLD_IM)[n] = real ? turn_im / square / rate : 0.0;
    for (int64_t row = 0; !real && row < m->rows; row++) output(m, STILL, row)[n] = 0.0;
  }
}

/* Advance a sleeping body to the present. */
void block_wake(const struct memory *m, int64_t number) {
  int64_t *b = body(m, number);
  if (!b[ASLEEP]) return;
  const double slept = (double)b[SLEPT];
  for (int64_t n = b[FIRST]; n < b[LAST]; n++) {
    const double size = exp(mode(m, LOG_RE)[n] * slept), angle = mode(m, LOG_IM)[n] * slept;
    const double turn_re = size * cos(angle), turn_im = size * sin(angle);
    const double re = mode(m, STATE_RE)[n], im = mode(m, STATE_IM)[n];
    mode(m, STATE_RE)[n] = re * turn_re - im * turn_im;
    mode(m, STATE_IM)[n] = re * turn_im + im * turn_re;
  }
  b[ASLEEP] = b[SLEPT] = 0;
}

/* Let modes ring for a block; what has died away becomes 0. */
static void leap(const struct memory *m, const int64_t *b) {
  const double *turn_re = mode(m, LEAP_RE), *turn_im = mode(m, LEAP_IM);
  double *restrict re = mode(m, STATE_RE), *restrict im = mode(m, STATE_IM);
  VECTORS for (int64_t n = b[FIRST]; n < b[LAST]; n++) {
    const double left = fabs(re[n]) + fabs(im[n]) > GONE ? 1.0 : 0.0;
    const double before = left * re[n], beside = left * im[n];
    re[n] = before * turn_re[n] - beside * turn_im[n];
    im[n] = before * turn_im[n] + beside * turn_re[n];
  }
}

/* Whether a body's loudest possible sound is below its share of the loudest so far. */
static int may_sleep(const struct memory *m, int64_t number) {
  const int64_t *b = body(m, number);
  const double *re = mode(m, STATE_RE), *im = mode(m, STATE_IM), *loud = mode(m, LOUDNESS);
  double total = 0.0;
  VECTORS for (int64_t n = b[FIRST]; n < b[LAST]; n++)
    total += loud[n] * (fabs(re[n]) + fabs(im[n]));
  double *loudest = m->level + LEVELS + number;
  *loudest = larger(*loudest, total);
  return total <= m->level[QUIET] * *loudest;
}

/* Compute minus the steady output under a unit force: added, it makes static load silent. */
void block_stand(const struct memory *m, int64_t number) {
  const int64_t *b = body(m, number);
  const double *hold_re = mode(m, HOLD_RE), *hold_im = mode(m, HOLD_IM);
  for (int64_t row = 0; row < m->rows; row++) {
    const double *re = output(m, OUT_RE, row), *im = output(m, OUT_IM, row);
    double *restrict still = output(m, STILL, row);
    VECTORS for (int64_t n = b[FIRST]; n < b[LAST]; n++)
      still[n] = -(re[n] * hold_im[n] + im[n] * hold_re[n]);
  }
}

/* Prepare output gains that move in this block. */
static void begin_outputs(const struct memory *m, const int64_t *b) {
  const double *inverse = mode(m, INVERSE), *turn = mode(m, TURN_RE);
  double *restrict loudness = mode(m, LOUDNESS);
  const double block = (double)m->block;
  for (int64_t n = b[FIRST]; n < b[LAST]; n++) loudness[n] = 0.0;
  for (int64_t row = 0; row < m->rows; row++) {
    const double *re = output(m, OUT_RE, row), *im = output(m, OUT_IM, row);
    const double *to_re = output(m, TARGET_RE, row), *to_im = output(m, TARGET_IM, row);
    double *restrict weight = output(m, WEIGHT, row), *restrict turned = output(m, TURNED, row);
    double *restrict weight_slope = output(m, WEIGHT_SLOPE, row);
    double *restrict turned_slope = output(m, TURNED_SLOPE, row);
    VECTORS for (int64_t n = b[FIRST]; n < b[LAST]; n++) {
      const double before = im[n] * inverse[n];
      const double change = (to_im[n] * inverse[n] - before) / block;
      turned[n] = before;
      turned_slope[n] = change;
      weight[n] = re[n] - before * turn[n];
      weight_slope[n] = (to_re[n] - re[n]) / block - change * turn[n];
      loudness[n] = larger(loudness[n], fabs(to_re[n]) + fabs(to_im[n]));
    }
  }
}

/* Arrive at the gains that outputs moved to. */
static void end_outputs(const struct memory *m, int64_t number) {
  int64_t *b = body(m, number);
  if (!b[BODY_MOVED]) return;
  const double *inverse = mode(m, INVERSE), *turn = mode(m, TURN_RE);
  for (int64_t row = 0; row < m->rows; row++) {
    const double *to_re = output(m, TARGET_RE, row), *to_im = output(m, TARGET_IM, row);
    double *restrict re = output(m, OUT_RE, row), *restrict im = output(m, OUT_IM, row);
    double *restrict weight = output(m, WEIGHT, row), *restrict turned = output(m, TURNED, row);
    double *restrict weight_slope = output(m, WEIGHT_SLOPE, row);
    double *restrict turned_slope = output(m, TURNED_SLOPE, row);
    VECTORS for (int64_t n = b[FIRST]; n < b[LAST]; n++) {
      re[n] = to_re[n];
      im[n] = to_im[n];
      turned[n] = to_im[n] * inverse[n];
      weight[n] = to_re[n] - turned[n] * turn[n];
      weight_slope[n] = turned_slope[n] = 0.0;
    }
  }
  block_stand(m, number);
  b[BODY_MOVED] = 0;
}

/* Prepare a drive that moves in this block. */
static void begin_drive(const struct memory *m, const int64_t *b, int64_t pushing) {
  if (!voice(m, pushing)[VOICE_MOVED]) return;
  const double *now = drive(m, NOW, pushing), *target = drive(m, TARGET, pushing);
  const double *given = mode(m, INPUT) + b[FIRST], block = (double)m->block;
  double *restrict gain = drive(m, GAIN, pushing), *restrict slope = drive(m, SLOPE, pushing);
  VECTORS for (int64_t n = 0; n < b[LAST] - b[FIRST]; n++) {
    gain[n] = now[n] * given[n];
    slope[n] = (target[n] - now[n]) * given[n] / block;
  }
}

/* Arrive at the drive that a voice moved to. */
static void end_drive(const struct memory *m, const int64_t *b, int64_t pushing) {
  if (!voice(m, pushing)[VOICE_MOVED]) return;
  const double *target = drive(m, TARGET, pushing), *given = mode(m, INPUT) + b[FIRST];
  double *restrict now = drive(m, NOW, pushing), *restrict gain = drive(m, GAIN, pushing);
  double *restrict slope = drive(m, SLOPE, pushing);
  VECTORS for (int64_t n = 0; n < b[LAST] - b[FIRST]; n++) {
    now[n] = target[n];
    gain[n] = target[n] * given[n];
    slope[n] = 0.0;
  }
  voice(m, pushing)[VOICE_MOVED] = 0;
}

/* Compute the direct gain of a voice's force at the begin (0) or end (1) of a block.

   It begins with the steady output of the poles before: a force stays silent when they change. */
static void take_feed(const struct memory *m, const int64_t *b, int64_t pushing, int64_t end) {
  const double *now = drive(m, NOW, pushing);
  for (int64_t row = 0; row < m->rows; row++) {
    const double *still = output(m, STILL, row) + b[FIRST];
    double level = 0.0;
    VECTORS for (int64_t n = 0; n < b[LAST] - b[FIRST]; n++) level += now[n] * still[n];
    feed(m, end, pushing)[row] = level;
  }
}

/* Add a force's direct part, which cancels the steady output: only changes are heard. */
static void direct(const struct memory *m, int64_t number, int64_t pushing) {
  const double *pushed = force(m, pushing);
  for (int64_t row = 0; row < m->rows; row++) {
    const double begin = feed(m, 0, pushing)[row], end = feed(m, 1, pushing)[row];
    const double step = (end - begin) / (double)m->block;
    double *restrict into = sound(m, number, row);
    VECTORS for (int64_t k = 0; k < m->block; k++)
      into[k] += (begin + step * (double)(k + 1)) * pushed[k];
    feed(m, 0, pushing)[row] = end;
  }
}

/* Let some voices push some outputs of a body; those that are not there are the silent one. */
static void run(const struct memory *m, int64_t number, int64_t row, const int64_t *voices,
                int64_t count, int ramped, int unit) {
  const int64_t *b = body(m, number), first = b[FIRST];
  struct group g = {
      .modes = b[LAST] - first, .block = m->block, .pushes = count,
      .outputs = least(m->rows, OUTPUTS), .turned = m->turned, .ramped = ramped, .unit = unit,
      .feedback = mode(m, FEEDBACK) + first, .loss = mode(m, LOSS) + first,
      .latest = mode(m, LATEST) + first, .previous = mode(m, PREVIOUS) + first};
  for (int p = 0; p < PUSHES; p++) {
    g.gain[p] = drive(m, GAIN, voices[p]);
    g.gain_slope[p] = drive(m, SLOPE, voices[p]);
    g.force[p] = force(m, voices[p]);
  }
  for (int64_t o = 0; o < g.outputs; o++) {
    g.weight[o] = output(m, unit ? UNIT_WEIGHT : WEIGHT, row + o) + first;
    g.turn[o] = output(m, unit ? UNIT_TURNED : TURNED, row + o) + first;
    g.weight_slope[o] = output(m, WEIGHT_SLOPE, row + o) + first;
    g.turn_slope[o] = output(m, TURNED_SLOPE, row + o) + first;
    g.sound[o] = sound(m, number, row + o);
  }
  bank_run(&g);
}

/* Let some voices push a body; later groups (`again`) start from a state of zero. */
static void push_together(const struct memory *m, int64_t number, const int64_t *voices,
                          int64_t count, int ramped, int unit, int again) {
  const int64_t *b = body(m, number);
  for (int64_t row = 0; row < m->rows; row += OUTPUTS) {
    if (again) {
      for (int64_t n = b[FIRST]; n < b[LAST]; n++)
        mode(m, LATEST)[n] = mode(m, PREVIOUS)[n] = 0.0;
    } else if (b[HELD_AS] == AS_STATE) {
      unpack(m, b);
    }
    run(m, number, row, voices, count, ramped, unit);
  }
}

/* Convert pairs to states, added to the states of earlier groups. */
static void put_back(const struct memory *m, const int64_t *b, int64_t count, int again) {
  if (count == 0 && !again)
    leap(m, b);
  else
    pack(m, b, again ? 1.0 : 0.0);
}

/* How many voices push a body. */
static int64_t pushing_count(const struct memory *m, const int64_t *b) {
  int64_t count = 0;
  for (int64_t each = b[VOICE]; each >= 0; each = voice(m, each)[NEXT]) count++;
  return count;
}

/* Let all voices push a body, as many at a time as kernels take. */
static void push(const struct memory *m, int64_t number, int ramped) {
  int64_t *b = body(m, number), each = b[VOICE], count = pushing_count(m, b);
  const int paired = m->rows <= OUTPUTS && 0 < count && count <= PUSHES;
  const int whole = m->block % bank_frame(least(m->rows, OUTPUTS), m->turned) == 0;
  const int unit = paired && !ramped && count == 1 && whole;
  if (unit && b[HELD_AS] != AS_UNIT_PAIRS)
    measure(m, number, each);
  else if (!paired || (b[HELD_AS] == AS_UNIT_PAIRS && !unit))
    block_settle(m, number);
  int again = 0;
  do {
    const int64_t silent = m->voices - 1;
    int64_t voices[PUSHES] = {silent, silent, silent, silent};
    for (count = 0; each >= 0 && count < PUSHES; count++) {
      voices[count] = each;
      each = voice(m, each)[NEXT];
    }
    push_together(m, number, voices, count, ramped, unit, again);
    if (!paired) put_back(m, b, count, again);
    again = 1;
  } while (each >= 0);
  if (paired) b[HELD_AS] = unit ? AS_UNIT_PAIRS : AS_PAIRS;
}

/* Whether all is as in the last block, and that had one steady push. */
static int steady(const struct memory *m, const int64_t *b) {
  if (b[HELD_AS] != AS_UNIT_PAIRS || b[BODY_MOVED] || b[VOICE] < 0) return 0;
  const int64_t *v = voice(m, b[VOICE]);
  return v[ACTIVE] == 1 && !v[VOICE_MOVED] && v[NEXT] < 0;
}

/* Let a sleeping body sleep on, or wake it. */
static int rest(const struct memory *m, int64_t number) {
  int64_t *b = body(m, number);
  if (b[VOICE] < 0 && !b[BODY_MOVED] && b[ASLEEP]) {
    b[SLEPT] += m->block;
    return 1;
  }
  block_wake(m, number);
  return 0;
}

/* Prepare all gains of a body; tell whether any of them moves. */
static int begin(const struct memory *m, const int64_t *b) {
  int moves = b[BODY_MOVED] != 0;
  if (moves) begin_outputs(m, b);
  for (int64_t each = b[VOICE]; each >= 0; each = voice(m, each)[NEXT]) {
    if (voice(m, each)[ACTIVE] > 1 || voice(m, each)[VOICE_MOVED]) {
      moves = 1;
      take_feed(m, b, each, 0);
      begin_drive(m, b, each);
    }
  }
  return moves;
}

/* Arrive at all gains of a body, and let it sleep when it has become silent. */
static void end(const struct memory *m, int64_t number, int moved) {
  int64_t *b = body(m, number);
  end_outputs(m, number);
  if (b[VOICE] < 0) b[ASLEEP] = may_sleep(m, number);
  for (int64_t each = b[VOICE]; each >= 0; each = voice(m, each)[NEXT]) {
    end_drive(m, b, each);
    if (moved) take_feed(m, b, each, 1);
    direct(m, number, each);
  }
}

/* Chain the voices that push each body in this block into a list. */
static void link_voices(const struct memory *m) {
  for (int64_t number = 0; number < m->bodies; number++) body(m, number)[VOICE] = -1;
  for (int64_t each = m->voices - 2; each >= 0; each--) {
    int64_t *v = voice(m, each);
    if (!v[ACTIVE]) continue;
    v[NEXT] = body(m, v[BODY])[VOICE];
    body(m, v[BODY])[VOICE] = each;
  }
}

/* Make one block of all bodies, in place in their memory. */
void block_make(const struct memory *m) {
  link_voices(m);
  for (int64_t k = 0; k < m->bodies * m->rows * m->block; k++) m->sound[k] = 0.0;
  for (int64_t number = 0; number < m->bodies; number++) {
    if (steady(m, body(m, number))) {
      const int64_t one = body(m, number)[VOICE], voices[PUSHES] = {one, one, one, one};
      run(m, number, 0, voices, 1, 0, 1);
      direct(m, number, one);
    } else if (!rest(m, number)) {
      const int ramped = begin(m, body(m, number));
      push(m, number, ramped);
      end(m, number, ramped);
    }
  }
}

/* Entries of Python: reals and whole numbers as struck.synth.memory lays them out. */
ENTRY void bank_make_block(double *reals, int64_t *wholes) {
  const struct memory m = memory_of(reals, wholes);
  block_make(&m);
}

ENTRY void bank_refresh(double *reals, int64_t *wholes, int64_t number) {
  const struct memory m = memory_of(reals, wholes);
  block_refresh(&m, number);
}

/* Convert a body's state to its complex c, as of now. */
ENTRY void bank_settle(double *reals, int64_t *wholes, int64_t number) {
  const struct memory m = memory_of(reals, wholes);
  block_settle(&m, number);
  block_wake(&m, number);
}

ENTRY void bank_stand(double *reals, int64_t *wholes, int64_t number) {
  const struct memory m = memory_of(reals, wholes);
  block_stand(&m, number);
}
