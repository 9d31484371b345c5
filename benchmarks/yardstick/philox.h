/* src/cornerforge/_philox.py */
#ifndef YARDSTICK_PHILOX_H
#define YARDSTICK_PHILOX_H

#include "elementary.h"

enum { PURPOSE_DECIDE = 1, PURPOSE_INITIAL = 2, PURPOSE_TRAITS = 7 };

typedef struct {
    uint64_t w[4];
} Words;

static inline Words block(int64_t seed, int64_t test, int64_t step, int64_t vehicle, int64_t purpose) {
    const uint64_t low = 0xFFFFFFFFu, s = (uint64_t)seed, t = (uint64_t)test;
    uint64_t c0 = t & low, c1 = t >> 32, c2 = (uint64_t)step, c3 = (uint64_t)vehicle | ((uint64_t)purpose << 16);
    uint64_t k0 = s & low, k1 = s >> 32;
    for (int round = 0; round < 10; round++) {
        uint64_t p0 = 0xD2511F53u * c0, p1 = 0xCD9E8D57u * c2;
        uint64_t n0 = (p1 >> 32) ^ c1 ^ k0, n2 = (p0 >> 32) ^ c3 ^ k1;
        c0 = n0, c1 = p1 & low, c2 = n2, c3 = p0 & low;
        k0 = (k0 + 0x9E3779B9u) & low;
        k1 = (k1 + 0xBB67AE85u) & low;
    }
    return (Words){{c0, c1, c2, c3}};
}

static inline void blocks(
    uint64_t *restrict words, int64_t slots, int64_t seed, int64_t test, int64_t step, int64_t n, int64_t purpose
) {
    for (int64_t i = 0; i < n; i++) {
        Words drawn = block(seed, test, step, i, purpose);
        for (int64_t k = 0; k < 4; k++) words[k * slots + i] = drawn.w[k];
    }
}

static inline double uniform(uint64_t word) { return ((double)word + 0.5) * 2.3283064365386963e-10; }

static inline void normal_pair(uint64_t word_a, uint64_t word_b, double *z_a, double *z_b) {
    double radius = sqrt(-2.0 * logarithm(uniform(word_a)));
    double sine, cosine;
    sin_cos(6.283185307179586 * uniform(word_b), &sine, &cosine);
    *z_a = radius * cosine;
    *z_b = radius * sine;
}

#endif
