/* Records of the host, taken over into the memory of all bodies.

   integers: voices (V, 3), bodies (B,), stretch (2,). reals: volume (1,), loads (V,), forces
   (V, block), beside (B, points, block), drives (V, width), outputs (2, points, N), poles (2, N), ways (2,
   paths, 3), responses (paths, taps). N modes of all bodies, V voices but the silent one. */
#include "record.h"

#include <math.h>
#include <string.h>

struct record record_of(const struct memory *m, const int64_t *integers, const double *reals,
                        int64_t points, int64_t paths) {
  struct record r = {.voices = m->voices - 1, .points = points, .voice = integers};
  r.body = r.voice + r.voices * RECORD_COLUMNS;
  r.stretch = r.body + m->bodies;
  r.volume = reals;
  r.loads = r.volume + 1;
  r.forces = r.loads + r.voices;
  r.beside = r.forces + r.voices * m->block;
  r.drives = r.beside + m->bodies * points * m->block;
  r.outputs = r.drives + r.voices * m->width;
  r.poles = r.outputs + 2 * points * m->modes;
  r.ways = r.poles + 2 * m->modes;
  r.responses = r.ways + 6 * paths;
  return r;
}

static void copy(double *restrict to, const double *restrict from, int64_t count) {
  memcpy(to, from, sizeof(double) * (uint64_t)count);
}

static void take_poles(const struct memory *m, const struct record *r, int64_t number) {
  int64_t *b = body(m, number), first = b[FIRST], count = b[LAST] - first;
  block_settle(m, number);
  block_wake(m, number);
  copy(mode(m, LOG_RE) + first, r->poles + first, count);
  copy(mode(m, LOG_IM) + first, r->poles + m->modes + first, count);
  for (int64_t n = first; n < b[LAST]; n++)
    if (mode(m, LOG_IM)[n] == 0.0) mode(m, STATE_RE)[n] = mode(m, STATE_IM)[n] = 0.0;
  block_refresh(m, number);
  b[BODY_MOVED] = 1;
  for (int64_t each = 0; each < r->voices; each++)
    if (voice(m, each)[BODY] == number) voice(m, each)[VOICE_MOVED] = 1;
}

static void take_outputs(const struct memory *m, const struct record *r, int64_t number) {
  int64_t *b = body(m, number), first = b[FIRST], count = b[LAST] - first;
  for (int64_t point = 0; point < r->points; point++) {
    const double *re = r->outputs + point * m->modes + first;
    const double *im = re + r->points * m->modes;
    copy(output(m, TARGET_RE, point) + first, re, count);
    copy(output(m, TARGET_IM, point) + first, im, count);
    if (r->body[number] & FIRST_OUTPUTS) {
      copy(output(m, OUT_RE, point) + first, re, count);
      copy(output(m, OUT_IM, point) + first, im, count);
    }
  }
  if (r->body[number] & FIRST_OUTPUTS) block_stand(m, number);
  b[BODY_MOVED] = 1;
}

static void take_push(const struct memory *m, const struct record *r, int64_t number) {
  int64_t *v = voice(m, number);
  const int64_t *now = r->voice + number * RECORD_COLUMNS;
  v[ACTIVE] = now[STATE];
  if (now[STATE] == SILENT) return;
  copy(force(m, number), r->forces + number * m->block, m->block);
  const double *wanted = r->drives + number * m->width;
  if (now[DRIVE_MOVED]) {
    copy(drive(m, TARGET, number), wanted, m->width);
    v[VOICE_MOVED] = 1;
  }
  if (now[STATE] == BEGIN) {
    v[BODY] = now[OF_BODY];
    copy(drive(m, NOW, number), wanted, m->width);
  }
}

void record_apply(const struct memory *m, const struct record *r) {
  for (int64_t number = 0; number < m->bodies; number++) {
    if (r->body[number] & NEW_POLES) take_poles(m, r, number);
    if (r->body[number] & NEW_OUTPUTS) take_outputs(m, r, number);
  }
  for (int64_t number = 0; number < r->voices; number++) take_push(m, r, number);
}

void record_hold(const struct memory *m, const struct record *r) {
  const double pi = 3.14159265358979323846;
  for (int64_t number = 0; number < r->voices; number++) {
    if (!voice(m, number)[ACTIVE]) continue;
    voice(m, number)[ACTIVE] = ON;
    double *pushed = force(m, number);
    const double load = r->loads[number], last = pushed[m->block - 1];
    for (int64_t k = 0; k < m->block; k++) {
      const double share = 0.5 + 0.5 * cos(pi * (double)(k + 1) / (double)m->block);
      pushed[k] = load + share * (last - load);
    }
  }
}
