/* src/cornerforge/geometry.py */
#ifndef YARDSTICK_GEOMETRY_H
#define YARDSTICK_GEOMETRY_H

#include "elementary.h"
#include "world.h"

static inline int64_t lane_of(double y, double lane_width) { return (int64_t)floor(y / lane_width); }

static inline double lane_centre(int64_t lane, double lane_width) { return ((double)lane + 0.5) * lane_width; }

static inline int64_t lane_bits(double y, double half_width, int64_t target_lane, double lane_width) {
    int64_t low = lane_of(y - half_width, lane_width), high = lane_of(y + half_width, lane_width);
    int64_t bits = (int64_t)1 << target_lane;
    if (low >= 0) bits |= (int64_t)1 << low;
    if (high >= 0) bits |= (int64_t)1 << high;
    return bits;
}

static bool boxes_overlap(const Vehicle *a, const Vehicle *b, double length, double width) {
    double dx = b->x - a->x, dy = b->y - a->y;
    double reach = sqrt(length * length + width * width);
    if (fabs(dx) >= reach || fabs(dy) >= reach) return false;
    if (a->heading == 0.0 && b->heading == 0.0) return fabs(dx) < length && fabs(dy) < width;
    double half_length = 0.5 * length, half_width = 0.5 * width;
    double sa, ca, sb, cb;
    sin_cos(a->heading, &sa, &ca);
    sin_cos(b->heading, &sb, &cb);
    double cos_between = fabs(ca * cb + sa * sb), sin_between = fabs(ca * sb - sa * cb);
    double along = half_length + half_length * cos_between + half_width * sin_between;
    double across = half_width + half_length * sin_between + half_width * cos_between;
    return fabs(dx * ca + dy * sa) < along && fabs(dy * ca - dx * sa) < across && fabs(dx * cb + dy * sb) < along &&
           fabs(dy * cb - dx * sb) < across;
}

static inline double path_position(const double *c, double t) {
    return c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * (c[4] + t * c[5]))));
}

static inline double path_speed(const double *c, double t) {
    return c[1] + t * (2.0 * c[2] + t * (3.0 * c[3] + t * (4.0 * c[4] + t * 5.0 * c[5])));
}

static inline double path_acceleration(const double *c, double t) {
    return 2.0 * c[2] + t * (6.0 * c[3] + t * (12.0 * c[4] + t * 20.0 * c[5]));
}

static double path_peak_acceleration(const double *path, double duration) {
    double first = fabs(path_acceleration(path, 0.0)), last = fabs(path_acceleration(path, duration));
    double peak = MAX(first, last);
    double a = 60.0 * path[5], b = 24.0 * path[4], c = 6.0 * path[3];
    double discriminant = b * b - 4.0 * a * c;
    if (discriminant > 0.0 && a != 0.0) {
        double root = sqrt(discriminant);
        double times[2] = {(-b + root) / (2.0 * a), (-b - root) / (2.0 * a)};
        for (int k = 0; k < 2; k++)
            if (0.0 < times[k] && times[k] < duration) {
                double here = fabs(path_acceleration(path, times[k]));
                peak = MAX(peak, here);
            }
    } else if (a == 0.0 && b != 0.0) {
        double t = -c / b;
        if (0.0 < t && t < duration) {
            double here = fabs(path_acceleration(path, t));
            peak = MAX(peak, here);
        }
    }
    return peak;
}

static void quintic(double *c, double y, double speed, double acceleration, double y_end, double t) {
    double a0 = 0.5 * acceleration;
    double rest = y_end - y - speed * t - a0 * t * t;
    double rest_speed = -speed - 2.0 * a0 * t;
    double rest_acceleration = -2.0 * a0;
    c[0] = y;
    c[1] = speed;
    c[2] = a0;
    c[3] = (10.0 * rest - 4.0 * rest_speed * t + 0.5 * rest_acceleration * t * t) / (t * t * t);
    c[4] = (-15.0 * rest + 7.0 * rest_speed * t - rest_acceleration * t * t) / (t * t * t * t);
    c[5] = (6.0 * rest - 3.0 * rest_speed * t + 0.5 * rest_acceleration * t * t) / (t * t * t * t * t);
}

/* Fills c and returns the duration. */
static double plan_path(
    double *c, double y, double speed, double acceleration, double y_end, double duration, double max_acceleration
) {
    double present = fabs(acceleration);
    double limit = MAX(max_acceleration, present) + 1e-9, longest = 8.0 * duration;
    quintic(c, y, speed, acceleration, y_end, duration);
    while (duration < longest && path_peak_acceleration(c, duration) > limit) {
        duration = 1.1 * duration;
        quintic(c, y, speed, acceleration, y_end, duration);
    }
    return duration;
}

#endif
