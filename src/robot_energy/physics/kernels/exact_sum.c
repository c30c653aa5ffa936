/* Sums of energies in whole microjoules and a remainder; see accounting/exact_sum.py.

   A microjoule count and a remainder of a part are whole multiples of their units and below 2^53
   of them, so sums of doubles are exact in any order. */

#include "kernels.h"

#define PER_JOULE 1e6
#define PART 4096                           /* rows, of 2 MJ at most each */
#define ROUND_WHOLE 6755399441055744.0      /* 1.5 * 2^52: adding it rounds to an integer */
#define ROUND_REMAINDER 6144.0              /* 1.5 * 2^(52 - 40): to the unit of remainders */
#define REMAINDERS 1099511627776.0          /* 2^40 */

/* Eight numbers, or less of them with 0 behind. */
INLINE lanes numbers_at(const char *from, int64_t stride, int64_t count) {
    lanes found = {0};
    if (stride == sizeof(double) && count >= LANES)
        __builtin_memcpy(&found, from, sizeof found);
    else
        for (int lane = 0; lane < LANES && lane < count; lane++)
            found[lane] = *(const double *)(from + lane * stride);
    return found;
}

CLONES void exact_sum_of_column(const char *energy, int64_t stride, int64_t rows,
                                int64_t *microjoule, int64_t *remainder) {
    for (int64_t start = 0; start < rows; start += PART) {
        int64_t stop = rows - start < PART ? rows : start + PART;
        lanes wholes = {0}, rests = {0};
        for (int64_t row = start; row < stop; row += LANES) {
            lanes rest = numbers_at(energy + row * stride, stride, stop - row) * PER_JOULE;
            lanes most = rest + ROUND_WHOLE - ROUND_WHOLE;
            rest -= most;
            wholes += most;
            rests += rest + ROUND_REMAINDER - ROUND_REMAINDER;
        }
        double total = 0.0, left = 0.0;
        for (int lane = 0; lane < LANES; lane++) {
            total += wholes[lane];
            left += rests[lane];
        }
        *microjoule = (int64_t)((uint64_t)*microjoule + (uint64_t)(int64_t)total);
        *remainder = (int64_t)((uint64_t)*remainder + (uint64_t)(int64_t)(left * REMAINDERS));
    }
}
