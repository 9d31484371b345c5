/* src/cornerforge/_elementary.py; why things are as they are is told there. */
#ifndef YARDSTICK_ELEMENTARY_H
#define YARDSTICK_ELEMENTARY_H

#include <math.h>
#include <stdint.h>
#include <string.h>

/* 1 / n! and 1 / (2 n + 1) */
static const double F[] = {
    1.0, 1.0, 1.0 / 2, 1.0 / 6, 1.0 / 24, 1.0 / 120, 1.0 / 720, 1.0 / 5040, 1.0 / 40320, 1.0 / 362880, 1.0 / 3628800,
    1.0 / 39916800, 1.0 / 479001600, 1.0 / 6227020800.0, 1.0 / 87178291200.0, 1.0 / 1307674368000.0,
    1.0 / 20922789888000.0, 1.0 / 355687428096000.0,
};
static const double ODD[] = {
    1.0, 1.0 / 3, 1.0 / 5, 1.0 / 7, 1.0 / 9, 1.0 / 11, 1.0 / 13, 1.0 / 15, 1.0 / 17, 1.0 / 19, 1.0 / 21, 1.0 / 23,
};
static const double ATAN[] = {0.0, 0x1.f5b75f92c80ddp-3, 0x1.dac670561bb4fp-2, 0x1.4978fa3269ee1p-1, 0x1.921fb54442d18p-1};
static const double ATAN_LACKS[] = {
    0.0, 0x1.8ab6e3cf7afbdp-57, 0x1.a2b7f222f65e2p-56, 0x1.2419a87f2a458p-56, 0x1.1a62633145c07p-55,
};
static const double ACOT[] = {
    0x1.921fb54442d18p+0, 0x1.5368c951e9cfdp+0, 0x1.1b6e192ebbe44p+0, 0x1.dac670561bb4fp-1, 0x1.921fb54442d18p-1,
};
static const double ACOT_LACKS[] = {
    0x1.1a62633145c07p-54, -0x1.96f47948a99f1p-54, 0x1.b1b466a88828ep-54, 0x1.a2b7f222f65e2p-55, 0x1.1a62633145c07p-55,
};
#define LN2_HIGH 0x1.62e42fee00000p-1
#define LN2_LOW 0x1.a39ef35793c76p-33

static inline double of_bits(int64_t bits) {
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

static inline double power_of_two(int64_t k) { return of_bits((k + 1023) * ((int64_t)1 << 52)); }

static inline double exponential(double x) {
    if (!(x >= -745.14)) return x != x ? x : 0.0;
    if (x > 709.79) return INFINITY;
    int64_t k = (int64_t)floor(x * 0x1.71547652b82fep+0 + 0.5);
    double high = x - (double)k * LN2_HIGH, low = (double)k * LN2_LOW;
    double r = high - low, lost = (high - r) - low;
    double z = r * r, w = z * z;
    double first = (F[2] + r * F[3]) + z * (F[4] + r * F[5]);
    double second = (F[6] + r * F[7]) + z * (F[8] + r * F[9]);
    double third = (F[10] + r * F[11]) + z * ((F[12] + r * F[13]) + z * F[14]);
    double near = 1.0 + r;
    lost += (1.0 - near) + r;
    double p = near + (lost + z * (first + w * (second + w * third)));
    int64_t half = k >> 1;
    return p * power_of_two(half) * power_of_two(k - half);
}

static inline double logarithm(double x) {
    if (!(x > 0.0)) return x == 0.0 ? -INFINITY : NAN;
    if (x == INFINITY) return x;
    int64_t k = 0, bits;
    if (x < 2.2250738585072014e-308) {
        x *= 18014398509481984.0;
        k = -54;
    }
    memcpy(&bits, &x, sizeof bits);
    int64_t shift = (bits - 0x3FE6A09E667F3BCD) >> 52;
    k += shift;
    double f = of_bits(bits - shift * ((int64_t)1 << 52)) - 1.0;
    double s = f / (2.0 + f), z = s * s, w = z * z;
    double even = ODD[1] + w * (ODD[3] + w * (ODD[5] + w * (ODD[7] + w * ODD[9])));
    double odd = ODD[2] + w * (ODD[4] + w * (ODD[6] + w * (ODD[8] + w * ODD[10])));
    double rest = 2.0 * z * (even + z * odd);
    double h = 0.5 * f * f;
    return (double)k * LN2_HIGH + (f - (h - (s * (h + rest) + (double)k * LN2_LOW)));
}

static inline void sin_cos(double x, double *sine, double *cosine) {
    double size = fabs(x), r = x, lost = 0.0;
    int64_t n = 0;
    if (!(size <= 524288.0)) {
        *sine = *cosine = NAN;
        return;
    }
    if (size < 7.450580596923828e-9) {
        *sine = x;
        *cosine = 1.0;
        return;
    }
    if (size > 0.7853981633974483) {
        n = (int64_t)floor(x * 0x1.45f306dc9c883p-1 + 0.5);
        double a = x - (double)n * 0x1.921fb54400000p+0;
        double b = (double)n * 0x1.0b4611a600000p-34, c = (double)n * 0x1.3198a2e000000p-69;
        double ab = a - b, back = ab - a;
        lost = (a - (ab - back)) - (b + back);
        double abc = ab - c;
        back = abc - ab;
        lost += (ab - (abc - back)) - (c + back);
        lost -= (double)n * 0x1.b839a252049c1p-104;
        r = abc + lost;
        lost = (abc - r) + lost;
    }
    double z = r * r, w = z * z;
    double even = -F[3] + w * (-F[7] + w * (-F[11] + w * -F[15]));
    double odd = F[5] + w * (F[9] + w * (F[13] + w * F[17]));
    double s = r + (r * (z * (even + z * odd)) + lost * (1.0 - 0.5 * z));
    even = F[4] + w * (F[8] + w * (F[12] + w * F[16]));
    odd = -F[6] + w * (-F[10] + w * -F[14]);
    double half = 0.5 * z, near = 1.0 - half;
    double c = near + (((1.0 - near) - half) + (w * (even + z * odd) - r * lost));
    if (n & 1) {
        double swapped = s;
        s = c;
        c = -swapped;
    }
    *sine = n & 2 ? -s : s;
    *cosine = n & 2 ? -c : c;
}

static inline double arctangent(double x) {
    double size = fabs(x), start = 0.0, lacks = 0.0, t = size;
    if (size < 7.450580596923828e-9) return x;
    if (size >= 0.1875) {
        if (size <= 1.0) {
            int64_t j = (int64_t)floor(4.0 * size + 0.5);
            double c = 0.25 * (double)j;
            start = ATAN[j];
            double below = 1.0 + size * c;
            t = (size - c) / below;
            lacks = ATAN_LACKS[j] - t * ((1.0 - below) + size * c);
        } else if (size < 18014398509481984.0) {
            int64_t j = (int64_t)floor(4.0 / size + 0.5);
            double c = 0.25 * (double)j, most = c < 0.5 ? c : 0.5;
            start = ACOT[j];
            lacks = ACOT_LACKS[j];
            t = ((most * size - 1.0) + (c - most) * size) / (size + c);
        } else {
            return x != x ? x : copysign(ACOT[0], x);
        }
    }
    double z = t * t, w = z * z;
    double even = ODD[1] + w * (ODD[3] + w * (ODD[5] + w * (ODD[7] + w * (ODD[9] + w * ODD[11]))));
    double odd = ODD[2] + w * (ODD[4] + w * (ODD[6] + w * (ODD[8] + w * ODD[10])));
    return copysign(start + (t - (t * (z * (even - z * odd)) - lacks)), x);
}

#endif
