/* The delay lines of a listener's ears, for the audio callback; delay_lines.c has the shapes. */
#ifndef STRUCK_DELAY_LINES_H
#define STRUCK_DELAY_LINES_H

#include "core.h"

ENTRY void ears_hear(const float *lines, int64_t half, int64_t now, const float *between,
                     int64_t fine, int64_t paths, const int64_t *line_of, const int64_t *ear_of,
                     const double *delays, const double *gains, int64_t taps, const float *before,
                     const float *after, int64_t since, int64_t stretch, int64_t block,
                     float *history, int64_t room, float *heard);

#endif
