/* Where everything lives that changes while sound plays: views of two arrays that Python lays out.

   struck.synth.memory says what each row holds; the numbers here are the same (a test compares). */
#ifndef STRUCK_MEMORY_H
#define STRUCK_MEMORY_H

#include "core.h"

/* Rows of modes: pole, what follows from it, state. */
enum mode_row {
  LOG_RE, LOG_IM, TURN_RE, TURN_IM, LEAP_RE, LEAP_IM, FEEDBACK, LOSS, INPUT, INVERSE,
  HOLD_RE, HOLD_IM, STATE_RE, STATE_IM, LATEST, PREVIOUS, LOUDNESS, UNIT, MODE_ROWS
};
/* Layers of outputs: gains now and at the block's end, and what they make. */
enum output_layer {
  OUT_RE, OUT_IM, TARGET_RE, TARGET_IM, WEIGHT, TURNED, WEIGHT_SLOPE, TURNED_SLOPE, STILL,
  UNIT_WEIGHT, UNIT_TURNED, OUTPUT_LAYERS
};
enum drive_layer { NOW, TARGET, GAIN, SLOPE, DRIVE_LAYERS };
enum body_column { FIRST, LAST, ASLEEP, SLEPT, BODY_MOVED, VOICE, HELD_AS, BODY_COLUMNS };
enum held_as { AS_STATE, AS_PAIRS, AS_UNIT_PAIRS };
enum voice_column { BODY, ACTIVE, VOICE_MOVED, NEXT, VOICE_COLUMNS };
enum level { RATE, QUIET, LEVELS };
/* Whole numbers at the front. */
enum header { BODIES, MODES, ROWS, VOICES, WIDTH, BLOCK, COMPLEX, HEADER };

struct memory {
  int64_t bodies, modes, rows, voices, width, block, turned;
  double *mode, *output, *drive, *force, *feed, *sound, *level;
  int64_t *body, *voice;
};

static inline int64_t lines(int64_t count) { return (count + 7) / 8 * 8; }

static inline struct memory memory_of(double *reals, int64_t *wholes) {
  struct memory m = {
      .bodies = wholes[BODIES], .modes = wholes[MODES], .rows = wholes[ROWS],
      .voices = wholes[VOICES], .width = wholes[WIDTH], .block = wholes[BLOCK],
      .turned = wholes[COMPLEX], .mode = reals, .body = wholes + HEADER};
  m.voice = m.body + m.bodies * BODY_COLUMNS;
  m.output = m.mode + MODE_ROWS * m.modes;
  m.drive = m.output + OUTPUT_LAYERS * m.rows * m.modes;
  m.force = m.drive + DRIVE_LAYERS * m.voices * m.width;
  m.feed = m.force + lines(m.voices * m.block);
  m.sound = m.feed + lines(2 * m.voices * m.rows);
  m.level = m.sound + lines(m.bodies * m.rows * m.block);
  return m;
}

static inline double *mode(const struct memory *m, enum mode_row row) {
  return m->mode + row * m->modes;
}
static inline double *output(const struct memory *m, enum output_layer layer, int64_t row) {
  return m->output + (layer * m->rows + row) * m->modes;
}
static inline double *drive(const struct memory *m, enum drive_layer layer, int64_t voice) {
  return m->drive + (layer * m->voices + voice) * m->width;
}
static inline double *force(const struct memory *m, int64_t voice) {
  return m->force + voice * m->block;
}
static inline double *feed(const struct memory *m, int64_t end, int64_t voice) {
  return m->feed + (end * m->voices + voice) * m->rows;
}
static inline double *sound(const struct memory *m, int64_t body, int64_t row) {
  return m->sound + (body * m->rows + row) * m->block;
}
static inline int64_t *body(const struct memory *m, int64_t number) {
  return m->body + number * BODY_COLUMNS;
}
static inline int64_t *voice(const struct memory *m, int64_t number) {
  return m->voice + number * VOICE_COLUMNS;
}

/* Of block.c, for the audio callback. */
void block_make(const struct memory *m);
void block_refresh(const struct memory *m, int64_t number);
void block_settle(const struct memory *m, int64_t number);
void block_wake(const struct memory *m, int64_t number);
void block_stand(const struct memory *m, int64_t number);

#endif
