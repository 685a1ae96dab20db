/* One group of pushes and outputs of one body, for the kernels of bank.c. */
#ifndef STRUCK_BANK_H
#define STRUCK_BANK_H

#include "core.h"

#if defined(__wasm__)
enum { PUSHES = 4, OUTPUTS = 1 }; /* most at a time: the page hears each body at one place */
#else
enum { PUSHES = 4, OUTPUTS = 8 };
#endif

struct group {
  int64_t modes, block; /* modes a multiple of 8, all rows of modes on a cache line */
  int64_t pushes, outputs; /* outputs 1, 2, 4 or 8; pushes that are not there are of a silence */
  int64_t turned, ramped, unit; /* complex outputs; gains that move; states in units of the gain */
  const double *feedback, *loss;
  double *latest, *previous;
  const double *gain[PUSHES], *gain_slope[PUSHES], *force[PUSHES];
  const double *weight[OUTPUTS], *weight_slope[OUTPUTS], *turn[OUTPUTS], *turn_slope[OUTPUTS];
  double *sound[OUTPUTS];
};

/* Add the sound of a block; in units of the gain it is a multiple of a frame. */
void bank_run(const struct group *g);
/* How many samples a frame of one steady push has. */
int64_t bank_frame(int64_t outputs, int64_t turned);

#endif
