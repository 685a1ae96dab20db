/* What the callback reaches: structs that struck.live.callback_memory and struck.live.ears fill. */
#ifndef STRUCK_CALLBACK_H
#define STRUCK_CALLBACK_H

#include "core.h"

/* A listener's ears; all lengths in numbers. delay_lines.c says what the arrays are. */
struct live_ears {
  int64_t lines, length, fine, paths, taps, ears, block, stretch, now;
  float *line, *between, *before, *after, *history, *heard;
  double *ways;
  int64_t *line_of, *ear_of;
};

/* What makes a block: the memory of all bodies, and how loudly they are heard. */
struct arena {
  double *reals;
  int64_t *wholes;
  int64_t points; /* of each body that are heard */
  double volume, peak; /* full scale per Pa at the end of the last block; loudest sample so far */
  double *beside; /* the last sample beside each body's modes (bodies, points) */
  struct live_ears *ears; /* none where one point hears all */
};

typedef void process(void *arena, const int64_t *integers, const double *reals, int64_t fresh,
                     double *outputs, int64_t channels);

/* What is counted. OPEN is set from outside: 1, as at first, fades in; 0 fades out and then ends
   the stream. */
enum counter { CALLS, UNDERFLOWS, LATE, HOLDING, OPEN };

struct shared {
  int64_t *records; /* queue */
  double *limited; /* state of the limiter */
  int64_t limited_size;
  void *arena;
  double *mix; /* (channels, block) */
  int64_t *counters;
  int64_t channels, block;
  process *process;
};

#endif
