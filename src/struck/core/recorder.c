/* What the audio device calls with each block that it records: frames are copied until there are as
   many as wanted. */
#include "core.h"

enum { CONTINUE, COMPLETE }; /* answers to PortAudio */
enum { INPUT_OVERFLOW = 2 }; /* its flag */

struct recording {
  float *samples; /* (wanted, channels) */
  int64_t wanted, done, channels, lost;
};

/* PaStreamCallback. */
ENTRY int recorder_take(const float *heard, void *played, unsigned long frames, const void *times,
                        unsigned long flags, struct recording *r) {
  (void)played, (void)times;
  const int64_t count = least((int64_t)frames, r->wanted - r->done);
  float *to = r->samples + r->done * r->channels;
  for (int64_t n = 0; n < count * r->channels; n++) to[n] = heard[n];
  if (flags & INPUT_OVERFLOW && r->done) r->lost++;
  __atomic_store_n(&r->done, r->done + count, __ATOMIC_RELEASE);
  return r->done == r->wanted ? COMPLETE : CONTINUE;
}
