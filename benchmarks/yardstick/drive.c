/* src/cornerforge/sim/drive.py: `drive_range` for naturalistic BVs and nobody controlled, the same loops in C99.
 *
 * The yardstick of `make bench`: as fast as a compiler makes these loops on this machine, and held to the kernels' last
 * bit by a test. One file for the compiler, so that it may put any function into any other, as Numba does. */
#include "step.h"
#include "traffic.h"

typedef struct {
    Road road;
    Av av;
    Tables tables;
    const double *accelerations;
} Setting;

typedef struct {
    uint8_t *code;
    int32_t *frame;
    int16_t *slot_a, *slot_b, *bv_crashes;
    int32_t *decisions;
    double *distance;
} Outcomes;

static void drive_test(World *w, int64_t seed, int64_t test, const Setting *s, Pairs *pairs) {
    reset_world(w, seed, test, &s->road, &s->av, &s->tables);
    for (int64_t step = 0; step < s->road.max_decisions && w->info[OUTCOME] == RUNNING; step++) {
        w->info[CONTROLLED] = -1;
        step_world(w, seed, test, &s->road, &s->av, &s->tables, s->accelerations, pairs);
    }
}

void drive_range(
    int64_t seed, int64_t first, int64_t count, const Setting *s, World *w, Pairs *pairs, const Outcomes *out
) {
    for (int64_t k = 0; k < count; k++) {
        drive_test(w, seed, first + k, s, pairs);
        out->code[k] = (uint8_t)w->info[OUTCOME];
        out->frame[k] = (int32_t)w->info[FRAME];
        out->slot_a[k] = (int16_t)w->info[SLOT_A];
        out->slot_b[k] = (int16_t)w->info[SLOT_B];
        out->bv_crashes[k] = (int16_t)w->info[N_BV_CRASHES];
        out->decisions[k] = (int32_t)w->info[N_DECISIONS];
        out->distance[k] = w->v[0].x - s->road.av_start;
    }
}
