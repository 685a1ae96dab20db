/* What the audio device calls for each block, and what it calls in turn to make one.

   It takes the next record of the host from the queue, lets `process` make the block, limits it and
   hands it over. All that it touches hangs on one struct, its `userData`. When no record has come in
   time it goes on with the last one, which stays in its slot until there is a newer one, and counts
   that as late. */
#include "callback.h"

#include "delay_lines.h"
#include "limiter.h"
#include "queue.h"
#include "record.h"

enum { CONTINUE, COMPLETE }; /* answers to PortAudio */
enum { OUTPUT_UNDERFLOW = 4 }; /* its flag */
enum { STANDING_BITS = 32 }; /* so many times as long, a stretch does not move within a block */

/* Add to each body what sounds beside its modes; where that is late, the last of it dies away. */
static void add_beside(const struct arena *a, const struct memory *m, const struct record *r,
                       int fresh) {
  for (int64_t number = 0; number < m->bodies; number++) {
    for (int64_t row = 0; row < m->rows; row++) {
      const double *from = r->beside + (number * m->rows + row) * m->block;
      double *restrict into = sound(m, number, row), *left = a->beside + number * m->rows + row;
      for (int64_t k = 0; k < m->block; k++)
        into[k] += fresh ? from[k] : *left * (double)(m->block - 1 - k) / (double)m->block;
      *left = fresh ? from[m->block - 1] : 0.0;
    }
  }
}

/* Add up all bodies in the channels, points in turn. */
static void mix(const struct memory *m, int64_t points, int64_t channels, double *outputs) {
  for (int64_t channel = 0; channel < channels; channel++) {
    double *restrict into = outputs + channel * m->block;
    for (int64_t number = 0; number < m->bodies; number++) {
      const double *from = sound(m, number, channel % points);
      for (int64_t k = 0; k < m->block; k++) into[k] += from[k];
    }
  }
}

/* Give each channel an ear in turn; a single channel gets the mean of all. */
static void hand_over(const struct live_ears *e, int64_t channels, double *outputs) {
  for (int64_t channel = 0; channel < channels; channel++) {
    double *restrict into = outputs + channel * e->block;
    for (int64_t ear = 0; ear < e->ears; ear++) {
      if (channels > 1 && ear != channel % e->ears) continue;
      const double share = channels > 1 ? 1.0 : 1.0 / (double)e->ears;
      for (int64_t k = 0; k < e->block; k++) into[k] += share * (double)e->heard[ear * e->block + k];
    }
  }
}

/* Take over new delays, gains and responses of the ears from a record. */
static void take_ways(const struct live_ears *e, const struct record *r) {
  if (!r->stretch[NEW_WAYS]) return;
  for (int64_t i = 0; i < 6 * e->paths; i++) e->ways[i] = r->ways[i];
  for (int64_t i = 0; i < e->paths * e->taps; i++) {
    e->before[i] = e->after[i];
    e->after[i] = (float)r->responses[i];
  }
}

/* Write what bodies sound like to the lines, one for each point, and hear it. Where nothing new is known, `held`, all
   stays as it was at the end of the block before. */
static void listen(struct live_ears *e, const struct memory *m, int64_t points, int64_t since,
                   int held) {
  const int64_t half = e->length / 2;
  int64_t stretch = e->stretch;
  if (held) {
    since = (since + e->block) << STANDING_BITS;
    stretch <<= STANDING_BITS;
  }
  for (int64_t line = 0; line < e->lines; line++) {
    const double *from = sound(m, line / points, line % points);
    float *to = e->line + line * e->length;
    for (int64_t k = 0; k < e->block; k++) {
      const int64_t place = (e->now + k) % half;
      to[place] = to[place + half] = (float)from[k];
    }
  }
  for (int64_t i = 0; i < e->ears * e->block; i++) e->heard[i] = 0;
  ears_hear(e->line, half, e->now, e->between, e->fine, e->paths, e->line_of, e->ear_of, e->ways,
            e->ways + 3 * e->paths, e->taps, e->before, e->after, since, stretch, e->block,
            e->history, e->taps - 1 + e->block, e->heard);
  e->now += e->block;
}

/* Go from the volume of the last block to this one's, and note the loudest sample. */
static void level(struct arena *a, double volume, int64_t channels, int64_t block,
                  double *outputs) {
  const double step = (volume - a->volume) / (double)block;
  for (int64_t channel = 0; channel < channels; channel++) {
    for (int64_t k = 0; k < block; k++) {
      double *sample = outputs + channel * block + k;
      *sample *= a->volume + step * (double)(k + 1);
      const double size = *sample < 0 ? -*sample : *sample;
      if (size > a->peak) a->peak = size;
    }
  }
  a->volume = volume;
}

/* A `process`, which is why it gets any arena. */
ENTRY void callback_sound(void *arena, const int64_t *integers, const double *reals, int64_t fresh,
                          double *outputs, int64_t channels) {
  struct arena *a = arena;
  const struct memory m = memory_of(a->reals, a->wholes);
  const int64_t paths = a->ears ? a->ears->paths : 0;
  const struct record r = record_of(&m, integers, reals, a->points, paths);
  if (fresh)
    record_apply(&m, &r);
  else
    record_hold(&m, &r);
  block_make(&m);
  add_beside(a, &m, &r, fresh);
  for (int64_t i = 0; i < channels * m.block; i++) outputs[i] = 0.0;
  if (a->ears) {
    if (fresh) take_ways(a->ears, &r);
    listen(a->ears, &m, a->points, r.stretch[SINCE], !fresh);
    hand_over(a->ears, channels, outputs);
  } else {
    mix(&m, a->points, channels, outputs);
  }
  level(a, *r.volume, channels, m.block, outputs);
}

/* Hold the next record, and return whether there was one; where not, it is late. */
static int take_block(struct shared *s) {
  const int fresh = queue_waiting(s->records) > s->counters[HOLDING];
  if (fresh && s->counters[HOLDING]) queue_release(s->records);
  if (fresh)
    s->counters[HOLDING] = 1;
  else if (s->counters[HOLDING])
    s->counters[LATE]++;
  return fresh;
}

/* PaStreamCallback. */
ENTRY int callback_play(const void *input, float *output, unsigned long frames, const void *times,
                        unsigned long flags, struct shared *s) {
  (void)input, (void)frames, (void)times;
  s->counters[CALLS]++;
  if (flags & OUTPUT_UNDERFLOW) s->counters[UNDERFLOWS]++;
  const int fresh = take_block(s);
  const int64_t count = s->channels * s->block;
  if (s->counters[HOLDING]) {
    const int64_t taken = s->records[TAKEN];
    s->process(s->arena, integers_of(s->records, taken), reals_of(s->records, taken), fresh,
               s->mix, s->channels);
  } else {
    for (int64_t i = 0; i < count; i++) s->mix[i] = 0.0;
  }
  const int64_t opened = acquire(s->counters + OPEN) != 0;
  limiter_limit(s->limited, s->limited_size, s->mix, s->channels, s->block, opened);
  for (int64_t channel = 0; channel < s->channels; channel++)
    for (int64_t frame = 0; frame < s->block; frame++)
      output[frame * s->channels + channel] = (float)s->mix[channel * s->block + frame];
  return opened || !limiter_is_closed(s->limited) ? CONTINUE : COMPLETE;
}
