/* Single and double layers of Helmholtz's equation on flat triangles of constant density.

   Rows belong to places (rows, 3), m, columns to elements: corners (elements, 3, 3), unit normals
   (3, elements), nodes of a rule of degree 2 (3 nodes, 3, elements), areas and longest edges
   (elements). With r from a node to a place, the layers are the integrals of exp(-i k r) / (4 pi r)
   and of its derivative along the element's normal. Far elements are summed over their nodes. Of
   near ones the static part is exact (Wilton et al. 1984; the solid angle: van Oosterom & Strackee
   1983), so that a thin wall's other side may be as near as it likes; what remains is smooth. */
#include <complex.h>
#include <math.h>

#include "core.h"

#define OVER_4_PI 0.07957747154594767
#define OVER_2_PI 0.15915494309189535
#define NEVER 1e-300 /* m^2, a distance of nothing */

typedef double _Complex Number;

typedef struct {
  int64_t elements;
  const double *corners, *normals, *nodes, *areas, *sizes;
  double wave; /* 1/m */
} Skin;

/* Cosine and sine of x >= 0 without a branch, within 1e-13: of a quarter of it, doubled twice. */
static inline void turn(double x, double *cosine, double *sine) {
  const double turns = floor(x * OVER_2_PI + 0.5);
  const double whole = (x - turns * 6.283185307179586) - turns * 2.4492935982947064e-16;
  const double t = 0.25 * whole, u = t * t;
  double s = t * (1 - u * (1.0 / 6) * (1 - u * (1.0 / 20) * (1 - u * (1.0 / 42) *
             (1 - u * (1.0 / 72) * (1 - u * (1.0 / 110) * (1 - u * (1.0 / 156) *
             (1 - u * (1.0 / 210))))))));
  const double v = 1 - u * (1.0 / 12) * (1 - u * (1.0 / 30) * (1 - u * (1.0 / 56) *
                   (1 - u * (1.0 / 90) * (1 - u * (1.0 / 132) * (1 - u * (1.0 / 182) *
                   (1 - u * (1.0 / 240)))))));
  double c = 1 - 0.5 * u * v;
  for (int twice = 0; twice < 2; twice++) {
    const double doubled = 2 * s * c;
    c = 1 - 2 * s * s;
    s = doubled;
  }
  *cosine = c;
  *sine = s;
}

/* One row of both layers, as if all elements were far. */
static void far_row(const Skin *skin, const double *place, double *restrict doubles,
                    double *restrict singles) {
  const int64_t n = skin->elements;
  const double wave = skin->wave, x = place[0], y = place[1], z = place[2];
  const double *const nx = skin->normals, *const ny = nx + n, *const nz = ny + n;
  for (int64_t j = 0; j < 2 * n; j++) doubles[j] = singles[j] = 0;
  for (int node = 0; node < 3; node++) {
    const double *const px = skin->nodes + 3 * node * n, *const py = px + n, *const pz = py + n;
    VECTORS for (int64_t j = 0; j < n; j++) {
      const double dx = x - px[j], dy = y - py[j], dz = z - pz[j];
      const double over = 1 / sqrt(larger(dx * dx + dy * dy + dz * dz, NEVER));
      const double phase = wave * (dx * dx + dy * dy + dz * dz) * over;
      double c, s;
      turn(phase, &c, &s);
      const double weight = skin->areas[j] * (OVER_4_PI / 3) * over;
      const double along = weight * over * over * (dx * nx[j] + dy * ny[j] + dz * nz[j]);
      singles[2 * j] += weight * c;
      singles[2 * j + 1] -= weight * s;
      doubles[2 * j] += along * (c + phase * s);
      doubles[2 * j + 1] += along * (phase * c - s);
    }
  }
}

static double dot(const double *a, const double *b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double *a, const double *b, double *out) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

/* The solid angle of a triangle seen from the origin, above 0 where its normal points away. */
static double solid_angle(const double corner[3][3], const double lengths[3]) {
  double normal[3];
  cross(corner[1], corner[2], normal);
  const double above = dot(corner[0], normal);
  const double beside = lengths[0] * lengths[1] * lengths[2] +
                        dot(corner[0], corner[1]) * lengths[2] +
                        dot(corner[1], corner[2]) * lengths[0] +
                        dot(corner[2], corner[0]) * lengths[1];
  return 2 * atan2(above, beside);
}

/* The integral of 1 / r over a triangle seen from the origin, without the part of its height. */
static double edge_sum(const double corner[3][3], const double lengths[3], const double *normal,
                       double size) {
  double sum = 0;
  for (int from = 0; from < 3; from++) {
    const int to = (from + 1) % 3;
    double way[3], outward[3];
    for (int axis = 0; axis < 3; axis++) way[axis] = corner[to][axis] - corner[from][axis];
    const double length = larger(sqrt(dot(way, way)), NEVER);
    for (int axis = 0; axis < 3; axis++) way[axis] /= length;
    cross(way, normal, outward);
    const double distance = dot(corner[from], outward);
    if (fabs(distance) < 1e-12 * size) continue;
    const double first = dot(corner[from], way), last = dot(corner[to], way);
    const double ratio = first + last < 0 ? (lengths[from] - first) / (lengths[to] - last)
                                          : (lengths[to] + last) / (lengths[from] + first);
    sum += distance * log(ratio);
  }
  return sum;
}

/* Add what is left of both layers once the static part is taken off, at one node. */
static void add_smooth(double wave, const double *way, const double *normal, double weight,
                       Number *both) {
  const double r = sqrt(larger(dot(way, way), NEVER)), phase = wave * r;
  double c, s;
  turn(phase, &c, &s);
  /* (exp(-i x) - 1) / r, and ((1 + i x) exp(-i x) - 1) / r^3: by series where x is small */
  const Number first = phase < 1e-3 ? wave * (-phase / 2 - I) : (c - 1 - I * s) / r;
  const Number second = phase < 1e-3
                            ? wave * wave / r * (0.5 - I * phase / 3)
                            : ((1 + I * phase) * (c - I * s) - 1) / (r * r * r);
  both[1] += weight * first;
  both[0] -= weight * dot(way, normal) * second;
}

/* Both layers of one near element, whose corners are seen from the place. */
static void near_element(const Skin *skin, int64_t j, const double *place, int own, Number *both) {
  const double normal[3] = {skin->normals[j], skin->normals[skin->elements + j],
                            skin->normals[2 * skin->elements + j]};
  double corner[3][3], lengths[3];
  for (int k = 0; k < 3; k++) {
    for (int axis = 0; axis < 3; axis++)
      corner[k][axis] = skin->corners[9 * j + 3 * k + axis] - place[axis];
    lengths[k] = sqrt(dot(corner[k], corner[k]));
  }
  const double angle = own ? 0 : solid_angle(corner, lengths);
  const double height = own ? 0 : fabs(dot(corner[0], normal));
  both[0] = -OVER_4_PI * angle;
  both[1] = OVER_4_PI * (edge_sum(corner, lengths, normal, skin->sizes[j]) - height * fabs(angle));
  /* four like triangles, three nodes each */
  const double weight = skin->areas[j] * (OVER_4_PI / 12);
  for (int part = 0; part < 4; part++)
    for (int node = 0; node < 3; node++) {
      double shares[3], way[3];
      for (int k = 0; k < 3; k++) {
        const double inner = k == node ? 2.0 / 3 : 1.0 / 6;
        shares[k] = part == 3 ? 0.5 - 0.5 * inner : 0.5 * inner + (k == part ? 0.5 : 0);
      }
      for (int axis = 0; axis < 3; axis++)
        way[axis] = shares[0] * corner[0][axis] + shares[1] * corner[1][axis] +
                    shares[2] * corner[2][axis];
      add_smooth(skin->wave, way, normal, weight, both);
    }
}

/* Rows of the double layers (rows, stride) and of the single layers (rows, elements). The place of
   row i is the centre of element first + i; none of them, where first is negative. Elements within
   `near` of their longest edges count as near. */
ENTRY void boundary_layers(int64_t rows, const double *places, int64_t first, int64_t elements,
                           const double *corners, const double *normals, const double *nodes,
                           const double *areas, const double *sizes, double wave, double near,
                           int64_t stride, Number *doubles, Number *singles) {
  const Skin skin = {elements, corners, normals, nodes, areas, sizes, wave};
  for (int64_t i = 0; i < rows; i++) {
    const double *const place = places + 3 * i;
    Number *const twice = doubles + i * stride, *const once = singles + i * elements;
    far_row(&skin, place, (double *)twice, (double *)once);
    for (int64_t j = 0; j < elements; j++) {
      double square = 0;
      for (int axis = 0; axis < 3; axis++) {
        const double *const at = corners + 9 * j + axis;
        const double apart = place[axis] - (at[0] + at[3] + at[6]) / 3;
        square += apart * apart;
      }
      if (square > near * near * sizes[j] * sizes[j]) continue;
      Number both[2];
      near_element(&skin, j, place, first >= 0 && first + i == j, both);
      twice[j] = both[0];
      once[j] = both[1];
    }
  }
}
