/* What the host gives the callback for one block: forces, and all that changed. */
#ifndef STRUCK_RECORD_H
#define STRUCK_RECORD_H

#include "memory.h"

/* What a voice does in a block, and flags of what is new to it or to a body. */
enum { SILENT, ON, BEGIN };
enum { NEW_POLES = 1, NEW_OUTPUTS = 2, FIRST_OUTPUTS = 4 };
/* Columns of `voices`, entries of `stretch`. */
enum { STATE, OF_BODY, DRIVE_MOVED, RECORD_COLUMNS };
enum { NEW_WAYS, SINCE, STRETCH };

struct record {
  int64_t voices, points; /* voices that a record speaks of; output points of a body */
  const int64_t *voice, *body, *stretch;
  const double *volume, *loads, *forces, *beside, *drives, *outputs, *poles, *ways, *responses;
};

/* Views of a slot; struck.live.ring lays it out. */
struct record record_of(const struct memory *m, const int64_t *integers, const double *reals,
                        int64_t points, int64_t paths);
/* Take over all that is new in a record. */
void record_apply(const struct memory *m, const struct record *r);
/* Move each force to its steady load within the block, as no new record has come. */
void record_hold(const struct memory *m, const struct record *r);

#endif
