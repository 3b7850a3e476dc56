/* A solver in C as a participant of an Arlequin run, over a socket. C99 and POSIX; docs/link.md has the protocol.
 *
 * Fill a struct arlequin_solver and call arlequin_serve. Unknowns of all arrays: x0 y0 z0 x1 ... (or x0 x1 ... with one
 * component), then rotations. SI units. Functions return 0, or another number after arlequin_fail with the reason. */
#ifndef ARLEQUIN_LINK_H
#define ARLEQUIN_LINK_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum arlequin_shape { ARLEQUIN_PARTICLES, ARLEQUIN_LINES, ARLEQUIN_TETRAHEDRA, ARLEQUIN_HEXAHEDRA };
enum arlequin_share { ARLEQUIN_INTERNAL, ARLEQUIN_KINETIC, ARLEQUIN_EXTERNAL };
/* Places at which weights are asked for, and points of each: values at points, means over the others (plane faces). */
enum arlequin_places { ARLEQUIN_AT_POINTS, ARLEQUIN_OVER_LINES, ARLEQUIN_OVER_TETRAHEDRA, ARLEQUIN_OVER_HEXAHEDRA };

struct arlequin_link;

struct arlequin_solver {
    const char *name, *kind;
    void *self;              /* yours */
    size_t nodes;
    int components;          /* displacements of a node: 1 to 3 */
    int rotations;           /* of a node: 0 or 3 */
    const double *positions; /* 3 per node [m] */
    enum arlequin_shape shape;
    size_t cells;             /* elements, or pairs of neighbours of particles */
    const uint32_t *cell_nodes; /* nodes of each: 2, 4 or 8; 2 of a pair */
    const double *volumes;    /* of particles [m3] */
    double section;           /* of lines [m2]; 1 otherwise */

    /* Ask arlequin_weights for the shares (all are one where link is NULL) and write the lumped inertia of every unknown
     * [kg] and the largest stable step [s] (INFINITY if it takes any). Called with NULL first. */
    int (*weigh)(void *self, struct arlequin_link *link, double *inertia, double *critical_step);
    int (*advance)(void *self, double time, double step);
    int (*velocities)(void *self, double *out);
    int (*displacements)(void *self, double *out);
    /* Change every velocity by impulse [kg m/s] over inertia, at once. */
    int (*kick)(void *self, const double *impulse);
    /* NULL where the solver has none. */
    int (*accelerations)(void *self, double *out);
    int (*invariant)(void *self, double *energy);
    /* What it must remember: memory numbers; 0 if it cannot be saved. */
    size_t memory;
    int (*save)(void *self, double *out);
    int (*restore)(void *self, const double *from);
};

/* Serves the run at an address ("unix:PATH", "tcp:127.0.0.1:PORT"; NULL: that of ARLEQUIN_LINK) until it ends. 0 if all went
 * well; otherwise what arlequin_reason says. */
int arlequin_serve(const char *address, struct arlequin_solver *solver);

/* Weights of one kind at count places, by the coordinates of their points. */
int arlequin_weights(struct arlequin_link *link, enum arlequin_share share, enum arlequin_places what, size_t count,
                     const double *points, double *out);

/* Says why a function fails, and returns 1. */
int arlequin_fail(const char *reason);
/* Tells the run that an answer takes longer than its timeout. */
int arlequin_working(struct arlequin_link *link);
/* The link that is being served, for arlequin_working. */
struct arlequin_link *arlequin_current(void);
const char *arlequin_reason(void);

#ifdef __cplusplus
}
#endif
#endif
