/* Masses and springs along x, with velocity Verlet of their own, as the fine side of a run: chain [address]. */
#include "arlequin_link.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define BONDS 60
#define NODES (BONDS + 1)

static double positions[3 * NODES], ends[6 * BONDS];
static uint32_t bonds[2 * BONDS];
static const double start = -20, spacing = 1, mass = 1, stiffness = 1;

/* What it must remember: numbers alone. */
struct motion {
    double q[NODES], v[NODES], step;
};
struct chain {
    double m[NODES], f[NODES], k[BONDS];
    struct motion now;
};

static void find_forces(struct chain *c) {
    memset(c->f, 0, sizeof c->f);
    for (int b = 0; b < BONDS; b++) {
        double tension = c->k[b] * (c->now.q[b + 1] - c->now.q[b]);
        c->f[b] += tension;
        c->f[b + 1] -= tension;
    }
}

static int weigh(void *self, struct arlequin_link *link, double *inertia, double *critical_step) {
    struct chain *c = self;
    double share[BONDS];
    if (arlequin_weights(link, ARLEQUIN_INTERNAL, ARLEQUIN_OVER_LINES, BONDS, ends, share)) return 1;
    for (int b = 0; b < BONDS; b++) c->k[b] = stiffness * share[b];
    if (arlequin_weights(link, ARLEQUIN_KINETIC, ARLEQUIN_OVER_LINES, BONDS, ends, share)) return 1;
    memset(c->m, 0, sizeof c->m);
    for (int b = 0; b < BONDS; b++) {
        c->m[b] += 0.5 * mass * share[b];
        c->m[b + 1] += 0.5 * mass * share[b];
    }
    memcpy(inertia, c->m, sizeof c->m);
    *critical_step = sqrt(mass / stiffness);
    find_forces(c);
    return 0;
}

static int advance(void *self, double time, double step) {
    struct chain *c = self;
    (void)time;
    for (int i = 0; i < NODES; i++) c->now.v[i] += 0.5 * step * c->f[i] / c->m[i];
    for (int i = 0; i < NODES; i++) c->now.q[i] += step * c->now.v[i];
    find_forces(c);
    for (int i = 0; i < NODES; i++) c->now.v[i] += 0.5 * step * c->f[i] / c->m[i];
    c->now.step = step;
    return 0;
}

static int velocities(void *self, double *out) {
    memcpy(out, ((struct chain *)self)->now.v, NODES * sizeof *out);
    return 0;
}
static int displacements(void *self, double *out) {
    memcpy(out, ((struct chain *)self)->now.q, NODES * sizeof *out);
    return 0;
}
static int accelerations(void *self, double *out) {
    struct chain *c = self;
    for (int i = 0; i < NODES; i++) out[i] = c->f[i] / c->m[i];
    return 0;
}
static int kick(void *self, const double *impulse) {
    struct chain *c = self;
    for (int i = 0; i < NODES; i++) c->now.v[i] += impulse[i] / c->m[i];
    return 0;
}

/* What velocity Verlet keeps at whole steps. */
static int invariant(void *self, double *energy) {
    struct chain *c = self;
    *energy = 0;
    for (int i = 0; i < NODES; i++)
        *energy += 0.5 * c->m[i] * c->now.v[i] * c->now.v[i] - 0.125 * c->now.step * c->now.step * c->f[i] * c->f[i] / c->m[i];
    for (int b = 0; b < BONDS; b++) {
        double stretch = c->now.q[b + 1] - c->now.q[b];
        *energy += 0.5 * c->k[b] * stretch * stretch;
    }
    return 0;
}

static int save(void *self, double *out) {
    memcpy(out, &((struct chain *)self)->now, sizeof(struct motion));
    return 0;
}
static int restore(void *self, const double *from) {
    memcpy(&((struct chain *)self)->now, from, sizeof(struct motion));
    find_forces(self);
    return 0;
}

int main(int count, char **arguments) {
    static struct chain c;
    struct arlequin_solver solver = {.name = "chain", .kind = "c-chain", .self = &c, .nodes = NODES, .components = 1,
        .positions = positions, .shape = ARLEQUIN_LINES, .cells = BONDS, .cell_nodes = bonds, .section = 1,
        .weigh = weigh, .advance = advance, .velocities = velocities, .displacements = displacements, .kick = kick,
        .accelerations = accelerations, .invariant = invariant, .memory = 2 * NODES + 1, .save = save, .restore = restore};
    for (int i = 0; i < NODES; i++) positions[3 * i] = start + spacing * i;
    for (uint32_t b = 0; b < BONDS; b++) {
        bonds[2 * b] = b;
        bonds[2 * b + 1] = b + 1;
        memcpy(ends + 6 * b, positions + 3 * b, 6 * sizeof *ends);
    }
    if (arlequin_serve(count > 1 ? arguments[1] : NULL, &solver)) {
        fprintf(stderr, "chain: %s\n", arlequin_reason());
        return 1;
    }
    return 0;
}
