/* Mode shapes of a triangle surface, between the corners of a face and along the way of a push.

   shapes (vertices, 3, modes), corners (pushes, 3) of the faces pushed on, weights (pushes, 3) of
   these corners, ways (pushes, 3). out (pushes, modes). */
#include "core.h"

ENTRY void shapes_along(const float *shapes, int64_t modes, const int64_t *corners,
                        const double *weights, const double *ways, int64_t pushes,
                        double *restrict out) {
  for (int64_t k = 0; k < pushes; k++) {
    double *restrict row = out + k * modes;
    for (int64_t m = 0; m < modes; m++) row[m] = 0.0;
    for (int64_t corner = 3 * k; corner < 3 * k + 3; corner++)
      for (int64_t axis = 0; axis < 3; axis++) {
        const double share = weights[corner] * ways[3 * k + axis];
        const float *shape = shapes + (3 * corners[corner] + axis) * modes;
        VECTORS for (int64_t m = 0; m < modes; m++) row[m] += share * (double)shape[m];
      }
  }
}
