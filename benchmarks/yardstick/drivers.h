/* src/cornerforge/drivers/idm.py, mobil.py, naturalistic.py */
#ifndef YARDSTICK_DRIVERS_H
#define YARDSTICK_DRIVERS_H

#include "philox.h"
#include "world.h"

#define NO_CHANGE (-1e9)

static inline double desired_gap(double speed, double range_rate, const Idm *p) {
    double dynamic =
        speed * p->time_gap - speed * range_rate / (2.0 * sqrt(p->max_acceleration * p->comfortable_braking));
    return p->standstill_gap + MAX(0.0, dynamic);
}

static inline double idm_acceleration(double speed, double gap, double range_rate, const Idm *p) {
    double ratio = speed / p->desired_speed;
    ratio *= ratio;
    double wish = desired_gap(speed, range_rate, p) / MAX(gap, 0.1);
    double command = p->max_acceleration * (1.0 - ratio * ratio - wish * wish);
    double above = MAX(-p->max_braking, command);
    return MIN(p->max_acceleration, above);
}

static inline double free_acceleration(double speed, const Idm *p) {
    double ratio = speed / p->desired_speed;
    ratio *= ratio;
    double command = p->max_acceleration * (1.0 - ratio * ratio);
    double above = MAX(-p->max_braking, command);
    return MIN(p->max_acceleration, above);
}

static double mobil_gain(
    double speed, double acceleration_now, double lead_gap, double lead_speed, double rear_gap, double rear_speed,
    double rear_acceleration_now, const Idm *idm, const Mobil *mobil
) {
    if (lead_gap <= 0.0 || rear_gap <= 0.0) return NO_CHANGE;
    double rear_after = idm_acceleration(rear_speed, rear_gap, speed - rear_speed, idm);
    double own_after = idm_acceleration(speed, lead_gap, lead_speed - speed, idm);
    if (rear_after < -mobil->max_imposed_braking || own_after < -mobil->max_imposed_braking) return NO_CHANGE;
    double gain = own_after - acceleration_now;
    if (rear_gap < 1e9) gain += mobil->politeness * (rear_after - rear_acceleration_now);
    return gain;
}

enum { FIRST_FREE_ROW = 21 * 116 * 19, CUT_COLUMNS = 32, FIRST_PROBE = 15 };
#define MAX_TABLE_CLOSING 10.0
#define MAX_TABLE_GAP 115.5
#define NEAREST 0.5

static inline int64_t clamp(int64_t value, int64_t low, int64_t high) {
    int64_t below = MIN(high, value);
    return MAX(low, below);
}

static inline int64_t speed_index(double speed) { return clamp((int64_t)floor(speed + 0.5) - 20, 0, 20); }

static inline int64_t gap_index(double gap) { return clamp((int64_t)floor(gap + 0.5), 0, 115); }

static inline int64_t range_rate_index(double range_rate, double rounding) {
    return clamp((int64_t)floor(range_rate + rounding) + 10, 0, 18);
}

/* Returns the row of (gap, range rate) within one speed, -1 for free flow. */
static inline int64_t table_row(double gap, double range_rate, double rounding) {
    double closing = -range_rate;
    if (closing > MAX_TABLE_CLOSING && gap > 4.0) {
        double scale = MAX_TABLE_CLOSING / closing;
        gap = 4.0 + (gap - 4.0) * scale * scale;
    }
    if (gap > MAX_TABLE_GAP) return -1;
    return gap_index(gap) * 19 + range_rate_index(range_rate, rounding);
}

static inline int64_t free_row(double speed, double desired_speed) {
    int64_t lack = (int64_t)floor((desired_speed - speed) / 0.5 + 0.5) + 12;
    return FIRST_FREE_ROW + speed_index(speed) * 25 + MAX(0, MIN(24, lack));
}

static inline int64_t following_row(double speed, double desired_speed, double gap, double range_rate, double rounding) {
    int64_t row = table_row(gap, range_rate, rounding);
    return row < 0 ? free_row(speed, desired_speed) : speed_index(speed) * 116 * 19 + row;
}

#define LAST_WORD 0xFFFFFFFEu

static inline int64_t sample_row(const uint32_t *cuts, int64_t row, uint64_t word) {
    const uint32_t *cut = cuts + row * CUT_COLUMNS;
    word = MIN(word, LAST_WORD);
    int64_t index = (FIRST_PROBE + 1) * (cut[FIRST_PROBE] <= word);
    index += 8 * (cut[index + 7] <= word);
    index += 4 * (cut[index + 3] <= word);
    index += 2 * (cut[index + 1] <= word);
    index += cut[index] <= word;
    return index;
}

static inline double reflected(double u) {
    if (u < 0.0) return -u;
    return u > 1.0 ? 2.0 - u : u;
}

static inline uint64_t remembering_word(uint64_t word, double before, double habit, const Memory *m) {
    double draw = uniform(word), known = m->near + m->far;
    const double *way = m->ways + 4 * ((draw >= m->near) + (draw >= known) + (draw >= known + m->habit));
    double u = reflected(way[0] + way[1] * before + way[2] * habit + way[3] * draw);
    uint64_t remembered = (uint64_t)(u * 4294967296.0);
    return MIN(remembered, 0xFFFFFFFFu);
}

/* The word of the quantile among all drivers, from that of a driver's own rank. */
static inline uint64_t own_word(uint64_t word, double noise) {
    double off = uniform(word) - 0.5, limit = 0.25 * (1.0 - noise), middle = MIN(fabs(off), limit);
    double stretch = 1.0 / (1.0 - noise * noise);
    double way = (1.0 + noise) * stretch * middle + (1.0 - noise) * stretch * (fabs(off) - middle);
    double quantile = 0.5 + copysign(way, off);
    uint64_t own = (uint64_t)(quantile * 4294967296.0);
    return MIN(own, 0xFFFFFFFFu);
}

static inline double turn_back_chance(const Tables *t, double gap, double range_rate) {
    if (gap <= 0.0) return 1.0;
    int64_t row = table_row(gap, range_rate, NEAREST);
    return row < 0 ? 0.0 : (double)t->lc_turn_back[row];
}

static inline double lane_change_base(const Tables *t, double speed, double lead_gap, double range_rate) {
    int64_t row = table_row(lead_gap, range_rate, NEAREST);
    double desire = row < 0 ? t->lc_desire_free : (double)t->lc_desire[row];
    return (double)t->lc_base[speed_index(speed)] * desire;
}

static inline double accept_chance(const Tables *t, int64_t rear, double gap, double range_rate) {
    if (gap <= 0.0) return 0.0;
    int64_t row = table_row(gap, range_rate, 0.0);
    if (row < 0) return 1.0;
    if (row % 19 == 18) row -= 1;
    double share = MAX(0.0, MIN(1.0, range_rate + 10.0 - (double)(row % 19)));
    const float *accept = t->lc_accept + rear * 116 * 19 + row;
    return (1.0 - share) * (double)accept[0] + share * (double)accept[1];
}

#endif
