/* Mode shapes of a triangle surface at places on its faces, along the ways of pushes there.

   points (vertices, 3), m, and shapes (vertices, 3, modes) of the surface; corners (pushes, 3) of
   the faces pushed on, places (pushes, 3), m, ways (pushes, 3). out (pushes, modes). */
#include "core.h"

#include <float.h>

static double dot(const double a[3], const double b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* The weights of three corners that make a place. */
static void weigh(const double *a, const double *b, const double *c, const double *place,
                  double weights[3]) {
  double u[3], v[3], o[3];
  for (int i = 0; i < 3; i++) {
    u[i] = b[i] - a[i];
    v[i] = c[i] - a[i];
    o[i] = place[i] - a[i];
  }
  const double uu = dot(u, u), uv = dot(u, v), vv = dot(v, v), ou = dot(o, u), ov = dot(o, v);
  const double area = larger(uu * vv - uv * uv, DBL_MIN);
  weights[1] = smaller(larger((vv * ou - uv * ov) / area, 0.0), 1.0);
  weights[2] = smaller(larger((uu * ov - uv * ou) / area, 0.0), 1.0 - weights[1]);
  weights[0] = 1.0 - weights[1] - weights[2];
}

ENTRY void shapes_along(const double *points, const float *shapes, int64_t modes,
                        const int64_t *corners, const double *places, const double *ways,
                        int64_t pushes, double *restrict out) {
  for (int64_t k = 0; k < pushes; k++) {
    const int64_t *corner = corners + 3 * k;
    double *restrict row = out + k * modes, weights[3];
    weigh(points + 3 * corner[0], points + 3 * corner[1], points + 3 * corner[2], places + 3 * k,
          weights);
    for (int64_t m = 0; m < modes; m++) row[m] = 0.0;
    for (int c = 0; c < 3; c++)
      for (int axis = 0; axis < 3; axis++) {
        const double share = weights[c] * ways[3 * k + axis];
        const float *shape = shapes + (3 * corner[c] + axis) * modes;
        VECTORS for (int64_t m = 0; m < modes; m++) row[m] += share * (double)shape[m];
      }
  }
}
