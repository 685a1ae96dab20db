/* Delay lines: each path reads the sound of a body as late and as loudly as the way to an ear
   leaves it, between samples too, and convolves it with the ear's response:

     place(k) = now + k - delay(k),  fresh(k) = gain(k) sum_n w_n(place) line[whole(place) - 15 + n],
     heard(k) += sum_t (before[t] + share(k) (after[t] - before[t])) fresh(k - t).

   Delays and gains follow a parabola through three values, share(k) = (since + k + 1) / stretch.

   lines (L, 2 half): each line twice, sample n at n modulo half, a power of two.
   between (fine + 1, READ): weights w for places between two samples.
   line_of, ear_of (P,), delays, gains (P, 3), before, after (P, taps): taps a multiple of 4.
   history (P, room), room at least taps - 1 + block: what was read before, then what is read now;
   it moves on.
   heard (ears, block): added to. Blocks are taken in tiles of at most TILE samples. */
#include "delay_lines.h"

#include <math.h>

enum { READ = 32, TILE = 256 };
#define FARTHEST 0x1p62 /* samples that can be counted */

static double parabola(const double *values, double u) {
  return (1 - u) * (1 - 2 * u) * values[0] + 4 * u * (1 - u) * values[1] + u * (2 * u - 1) * values[2];
}

/* Read one line (2 half,) into fresh (size,), size at most TILE. Where to read is found for all
   samples first: sums then do not wait for it. */
static void read_line(const float *line, int64_t half, int64_t now, const float *between,
                      int64_t fine, const double *delays, const double *gains, int64_t since,
                      int64_t stretch, int64_t size, float *restrict fresh) {
  int64_t starts[TILE];
  double rows[TILE];
  VECTORS
  for (int64_t k = 0; k < size; k++) {
    const double u = (double)(since + k + 1) / (double)stretch;
    const double place = (double)(now + k) - parabola(delays, u);
    const double whole = fabs(place) < FARTHEST ? floor(place) : 0; /* 0: not a number */
    starts[k] = ((int64_t)whole - (READ / 2 - 1)) & (half - 1);
    rows[k] = (place - whole) * (double)fine;
    fresh[k] = (float)parabola(gains, u);
  }
  for (int64_t k = 0; k < size; k++) {
    const int64_t low = rows[k] >= 0 && rows[k] < (double)fine ? (int64_t)rows[k] : fine - 1;
    const float share = (float)(rows[k] - (double)low);
    const float *some = line + starts[k], *begin = between + low * READ, *end = begin + READ;
    float total = 0;
    VECTORS
    for (int64_t n = 0; n < READ; n++) total += (begin[n] + share * (end[n] - begin[n])) * some[n];
    fresh[k] *= total;
  }
}

/* Add to heard (size,) the convolution of samples (taps - 1 + size,) with a response that has gone
   shares (size,) of the way to another. Four taps at a time: a sum crosses memory once for them. */
static void convolve(const float *samples, int64_t taps, const float *before, const float *after,
                     const float *restrict shares, int64_t size, float *restrict heard) {
  float total[TILE];
  for (int64_t k = 0; k < size; k++) total[k] = 0;
  for (int64_t t = 0; t < taps; t += 4) {
    const float *h = before + t, *some = samples + taps - 4 - t;
    const float d0 = after[t] - h[0], d1 = after[t + 1] - h[1];
    const float d2 = after[t + 2] - h[2], d3 = after[t + 3] - h[3];
    const float h0 = h[0], h1 = h[1], h2 = h[2], h3 = h[3];
    VECTORS
    for (int64_t k = 0; k < size; k++) {
      const float share = shares[k];
      const float late = (h2 + share * d2) * some[k + 1] + (h3 + share * d3) * some[k];
      const float early = (h0 + share * d0) * some[k + 3] + (h1 + share * d1) * some[k + 2];
      total[k] += early + late;
    }
  }
  for (int64_t k = 0; k < size; k++) heard[k] += total[k];
}

/* Read all paths and add what they sound like at the ears. */
ENTRY void ears_hear(const float *lines, int64_t half, int64_t now, const float *between,
                     int64_t fine, int64_t paths, const int64_t *line_of, const int64_t *ear_of,
                     const double *delays, const double *gains, int64_t taps, const float *before,
                     const float *after, int64_t since, int64_t stretch, int64_t block,
                     float *history, int64_t room, float *heard) {
  for (int64_t first = 0; first < block; first += TILE) {
    const int64_t size = least(block - first, TILE), gone = since + first;
    float shares[TILE];
    for (int64_t k = 0; k < size; k++) shares[k] = (float)((double)(gone + k + 1) / (double)stretch);
    for (int64_t path = 0; path < paths; path++) {
      float *samples = history + path * room + first;
      read_line(lines + 2 * half * line_of[path], half, now + first, between, fine,
                delays + 3 * path, gains + 3 * path, gone, stretch, size, samples + taps - 1);
      convolve(samples, taps, before + taps * path, after + taps * path, shares, size,
               heard + block * ear_of[path] + first);
    }
  }
  for (int64_t path = 0; path < paths; path++) {
    float *samples = history + path * room;
    for (int64_t k = 0; k < taps - 1; k++) samples[k] = samples[k + block];
  }
}
