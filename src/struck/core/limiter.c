/* A limiter that looks ahead: hold, release, two moving averages, and the delayed samples times
   the gain (src/struck/live/limiter.py has the formulas, and makes the state).

   state (size,): numbers, whole ones too, in the places below; the first moving average's values
   (FIRST_LENGTH,), the second's (SECOND_LENGTH,), the queue's times (HELD,) and gains (HELD,), and
   the samples on their way (channels, DELAY).
   samples (channels, block): limited in place. */
#include "limiter.h"

#include <math.h>

enum {
  CEILING, RELEASE, FADE_STEP,
  CHANNELS, DELAY, HELD, FIRST_LENGTH, SECOND_LENGTH, UNIT,
  TIME, RELEASED, FIRST_SUM, SECOND_SUM, OPENING,
  OLDEST, NEWEST,
  REPLACED, LEAST_GAIN,
  HEAD
};

static const double NEARLY_OPEN = 1e-9, HALF_PI = 1.57079632679489661923;

/* The largest amplitude of all channels; what is not finite becomes 0 and is counted. */
static double loudest(double *state, double *sample, int64_t channels, int64_t block) {
  double peak = 0;
  for (int64_t channel = 0; channel < channels; channel++, sample += block) {
    if (!isfinite(*sample)) {
      *sample = 0;
      state[REPLACED] += 1;
    }
    peak = larger(peak, fabs(*sample));
  }
  return peak;
}

/* The least gain wanted of late; the queue holds times and gains that both rise. */
static double held(double *state, double wanted) {
  const int64_t size = (int64_t)state[HELD];
  double *times = state + HEAD + (int64_t)state[FIRST_LENGTH] + (int64_t)state[SECOND_LENGTH];
  double *gains = times + size;
  int64_t oldest = (int64_t)state[OLDEST], newest = (int64_t)state[NEWEST];
  if (newest > oldest && times[oldest % size] <= state[TIME] - (double)size) oldest++;
  while (newest > oldest && gains[(newest - 1) % size] >= wanted) newest--;
  times[newest % size] = state[TIME];
  gains[newest % size] = wanted;
  state[OLDEST] = (double)oldest;
  state[NEWEST] = (double)(newest + 1);
  return gains[oldest % size];
}

static double released(double *state, double wanted) {
  const double gain = state[RELEASED] + state[RELEASE] * (wanted - state[RELEASED]);
  return state[RELEASED] = wanted - gain < NEARLY_OPEN ? wanted : gain;
}

/* The mean of the means of the last gains, which are whole numbers of a unit: sums are exact. */
static double smoothed(double *state, double gain) {
  const int64_t first = (int64_t)state[FIRST_LENGTH], second = (int64_t)state[SECOND_LENGTH];
  const int64_t time = (int64_t)state[TIME];
  const double whole = floor(gain * state[UNIT]);
  double *place = state + HEAD + time % first;
  state[FIRST_SUM] += whole - *place;
  *place = whole;
  place = state + HEAD + first + time % second;
  state[SECOND_SUM] += state[FIRST_SUM] - *place;
  *place = state[FIRST_SUM];
  return state[SECOND_SUM] / ((double)(first * second) * state[UNIT]);
}

/* The next gain of the fade: a raised cosine, 0 to 1. */
static double faded(double *state, int64_t opened) {
  const double step = opened ? state[FADE_STEP] : -state[FADE_STEP];
  state[OPENING] = smaller(1, larger(0, state[OPENING] + step));
  if (state[OPENING] == 1) return 1;
  const double root = sin(HALF_PI * state[OPENING]);
  return root * root;
}

/* Exchange a sample of each channel for the one that entered the delay before it. */
static void play(double *late, int64_t delay, double ceiling, double *sample, int64_t channels,
                 int64_t block, double gain, double fade) {
  for (int64_t channel = 0; channel < channels; channel++, late += delay, sample += block) {
    const double bounded = smaller(ceiling, larger(-ceiling, *late * gain));
    *late = *sample;
    *sample = bounded * fade;
  }
}

/* Limit samples while the output opens (or stays open) or closes. */
ENTRY void limiter_limit(double *state, int64_t size, double *samples, int64_t channels,
                         int64_t block, int64_t opened) {
  const int64_t delay = (int64_t)state[DELAY];
  double *late = state + size - channels * delay;
  const double ceiling = state[CEILING];
  state[LEAST_GAIN] = 1;
  for (int64_t k = 0; k < block; k++) {
    const double peak = loudest(state, samples + k, channels, block);
    const double wanted = held(state, peak > ceiling ? ceiling / peak : 1);
    const double gain = smoothed(state, released(state, wanted));
    const double fade = faded(state, opened);
    state[LEAST_GAIN] = smaller(state[LEAST_GAIN], gain);
    play(late + (int64_t)state[TIME] % delay, delay, ceiling, samples + k, channels, block, gain,
         fade);
    state[TIME] += 1;
  }
}

/* Whether nothing is heard any more. */
ENTRY int64_t limiter_is_closed(const double *state) { return state[OPENING] == 0; }
