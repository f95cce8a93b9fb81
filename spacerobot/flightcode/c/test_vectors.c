/* Test of the functions against recorded vectors: counts differing values and their distance in units in the last place.
 *
 *     test_vectors FOLDER [FACTOR]
 *
 * Each FOLDER/NAME.bin holds, little-endian: "SRV2", uint32 size of a number, rows, inputs, outputs; then the numbers
 * of each row: inputs, outputs, bound. A value may differ by FACTOR times the bound, in roundings of the largest output
 * of its row; FACTOR is 1 if not given. Rows with the bound 0 must agree to the bit: no call of the mathematical
 * library acts on them. Prints a line for each function: name, values, differing values, largest distance [ulp],
 * largest difference relative to the row's rounding, mean and worst time of a row [ns], of three calls the shortest. */
#define _POSIX_C_SOURCE 199309L
#include <float.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "vector_table.h"

#define MAX_NUMBERS 65536

static real numbers[MAX_NUMBERS], results[MAX_NUMBERS];

/* Number of representable values between two values; 0 for two NaN. */
static double distance(real a, real b)
{
    integer i, j;
    if (isnan(a) || isnan(b)) {
        return (isnan(a) && isnan(b)) ? 0.0 : HUGE_VAL;
    }
    memcpy(&i, &a, sizeof a);
    memcpy(&j, &b, sizeof b);
    i = i < 0 ? LOWEST - i : i;
    j = j < 0 ? LOWEST - j : j;
    return fabs((double)i - (double)j);
}

static double now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec * 1e9 + (double)t.tv_nsec;
}

static int test(const vector_entry *entry, const char *folder, double factor)
{
    const real *arg[MAX_FIELDS];
    real *res[MAX_FIELDS];
    char path[4096], magic[4];
    uint32_t head[4], row, i, values = 0u, differing = 0u, wrong = 0u;
    double largest = 0.0, relative = 0.0, total = 0.0, worst = 0.0;
    FILE *file;
    if (snprintf(path, sizeof path, "%s/%s.bin", folder, entry->name) >= (int)sizeof path) {
        return 1;
    }
    file = fopen(path, "rb");
    if (file == NULL || fread(magic, 1u, 4u, file) != 4u || memcmp(magic, "SRV2", 4u) != 0 ||
        fread(head, sizeof head[0], 4u, file) != 4u || head[0] != sizeof(real) || head[2] + head[3] >= MAX_NUMBERS) {
        fprintf(stderr, "%s: no vectors of this precision\n", path);
        return 1;
    }
    numbers[0] = 0;
    for (i = 0u, row = 0u; i < entry->reads; ++i) {
        arg[i] = &numbers[row];
        row += entry->sizes[i];
    }
    for (i = 0u, row = 0u; i < entry->writes; ++i) {
        res[i] = &results[row];
        row += entry->sizes[entry->reads + i];
    }
    for (row = 0u; row < head[1]; ++row) {
        double begin, time = HUGE_VAL, scale = 0.0;
        int repeat;
        const real *expected = &numbers[head[2]];
        if (fread(numbers, sizeof(real), head[2] + head[3] + 1u, file) != head[2] + head[3] + 1u) {
            fprintf(stderr, "%s: ends in row %u\n", path, (unsigned)row);
            return 1;
        }
        for (repeat = 0; repeat < 3; ++repeat) {
            begin = now_ns();
            entry->function(arg, res);
            begin = now_ns() - begin;
            time = begin < time ? begin : time;
        }
        total += time;
        worst = time > worst ? time : worst;
        for (i = 0u; i < head[3]; ++i) {
            scale = fabs((double)expected[i]) > scale ? fabs((double)expected[i]) : scale;
        }
        for (i = 0u; i < head[3]; ++i) {
            const double ulp = distance(results[i], expected[i]);
            ++values;
            if (ulp > 0.0) {
                const double part = fabs((double)results[i] - (double)expected[i]) / (EPSILON * scale);
                ++differing;
                largest = ulp > largest ? ulp : largest;
                relative = !(part <= relative) ? part : relative;
                wrong += !(part <= factor * (double)expected[head[3]]) ? 1u : 0u;
            }
        }
    }
    fclose(file);
    printf("%s %u %u %.17g %.17g %.1f %.1f\n", entry->name, (unsigned)values, (unsigned)differing, largest, relative,
           total / (double)head[1], worst);
    return wrong > 0u ? 1 : 0;
}

int main(int count, char **words)
{
    const double factor = count > 2 ? atof(words[2]) : 1.0;
    int failed = 0;
    size_t i;
    if (count < 2) {
        fprintf(stderr, "usage: test_vectors FOLDER [FACTOR]\n");
        return 2;
    }
    for (i = 0u; i < sizeof vector_table / sizeof vector_table[0]; ++i) {
        const int wrong = test(&vector_table[i], words[1], factor);
        if (wrong) {
            fprintf(stderr, "%s: DIFFERS\n", vector_table[i].name);
        }
        failed += wrong;
    }
    return failed ? 1 : 0;
}
