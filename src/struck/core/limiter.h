/* The limiter, for the audio callback; limiter.c says what the arrays are. */
#ifndef STRUCK_LIMITER_H
#define STRUCK_LIMITER_H

#include "core.h"

ENTRY void limiter_limit(double *state, int64_t size, double *samples, int64_t channels,
                         int64_t block, int64_t opened);
ENTRY int64_t limiter_is_closed(const double *state);

#endif
