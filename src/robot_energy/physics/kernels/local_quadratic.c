/* Slopes of local quadratics through irregular samples; see physics/derivative.py.

   Eight rows side by side. All operations of a row stand in the order of the numpy form, so both
   give the same bits. A sample outside of the window of a row has the weight 0 and the value 0. */

#include "kernels.h"

/* Samples at some offset from each row; 0 where they lie outside of its window. */
INLINE lanes values_at(const double *column, const int64_t *row, const whole *inside,
                       int64_t offset, int plain) {
    lanes found = {0};
    if (plain) {
        __builtin_memcpy(&found, column + row[0] + offset, sizeof found);
        return (lanes)((whole)found & *inside);
    }
    for (int lane = 0; lane < LANES; lane++)
        if ((*inside)[lane]) found[lane] = column[row[lane] + offset];
    return found;
}

/* Eight rows from the first on, the last one repeated for those beyond; the windows reach from low to
   high, which count from each row. */
CLONES void slopes_of_rows(const slopes *task, int64_t first, const int64_t *low,
                           const int64_t *high, int64_t behind, int64_t ahead) {
    int64_t row[LANES];
    int count = task->stop - first < LANES ? (int)(task->stop - first) : LANES;
    whole lows, highs;
    __builtin_memcpy(&lows, low, sizeof lows);
    __builtin_memcpy(&highs, high, sizeof highs);
    for (int lane = 0; lane < LANES; lane++) row[lane] = first + (lane < count ? lane : count - 1);
    int plain = count == LANES && first + behind >= 0 && first + LANES + ahead <= task->rows;
    lanes now, u[MAX_WINDOW];
    for (int lane = 0; lane < LANES; lane++) now[lane] = task->time[row[lane]];
    whole inside[MAX_WINDOW];
    lanes s1 = {0}, s2 = {0}, s3 = {0}, s4 = {0};
    const double unit = 1e-9 / task->scale;
    for (int64_t offset = behind; offset <= ahead; offset++) {
        int64_t index = offset - behind;
        inside[index] = ~negative((offset - lows) | (highs - offset));
        lanes time = values_at(task->time, row, &inside[index], offset, plain) - now;
        lanes one = (lanes)((whole)(time * unit) & inside[index]), two = one * one;
        u[index] = one;
        s1 += one;
        s2 += two;
        s3 += two * one;
        s4 += two * two;
    }
    whole counts = highs - lows + 1;
    lanes s0 = __builtin_convertvector(counts, lanes);
    lanes a = s2 * s4 - s3 * s3, b = s1 * s4 - s2 * s3, c = s1 * s3 - s2 * s2;
    lanes determinant = s0 * a - s1 * b + s2 * c;
    lanes d = s0 * s4 - s2 * s2, e = s0 * s3 - s1 * s2, f = s0 * s2 - s1 * s1;
    lanes c0 = -b / determinant, c1 = d / determinant, c2 = -e / determinant;
    for (int lane = 0; lane < LANES; lane++)
        if (counts[lane] < 3) { /* a line through two samples, nothing through one */
            double line = counts[lane] == 2 ? 1.0 / f[lane] : NOT_A_NUMBER;
            c0[lane] = -s1[lane] * line;
            c1[lane] = s0[lane] * line;
            c2[lane] = 0.0 * s0[lane];
        }
    for (int64_t index = 0; index <= ahead - behind; index++) {
        lanes weight = (c2 * u[index] + c1) * u[index] + c0;
        u[index] = (lanes)((whole)weight & inside[index]);
    }
    for (int64_t column = 0; column < task->columns; column++) {
        const double *values = task->values + column * task->rows;
        lanes sum = {0};
        for (int64_t index = 0; index <= ahead - behind; index++)
            sum += u[index] * values_at(values, row, &inside[index], behind + index, plain);
        double *out = task->out + column * (task->stop - task->start) + (first - task->start);
        sum /= task->scale;
        for (int lane = 0; lane < count; lane++) out[lane] = sum[lane];
    }
}

/* Return 0, or 1 where a window has more than MAX_WINDOW samples. */
int local_slopes(const slopes *task) {
    int64_t low = 0, high = 0, lows[LANES], highs[LANES];
    for (int64_t first = task->start; first < task->stop; first += LANES) {
        int64_t behind = 0, ahead = 0;
        for (int lane = 0; lane < LANES; lane++) {
            int64_t row = first + lane;
            if (row < task->stop) {
                int64_t now = task->stamp[row], begin, end;
                while (task->stamp[low] < now - task->behind_ns) low++;
                while (high < task->rows && task->stamp[high] <= now + task->ahead_ns) high++;
                begin = row - task->least_behind < low ? row - task->least_behind : low;
                end = row + task->least_ahead > high - 1 ? row + task->least_ahead : high - 1;
                lows[lane] = (begin < 0 ? 0 : begin) - row;
                highs[lane] = (end > task->rows - 1 ? task->rows - 1 : end) - row;
            } else {
                lows[lane] = lows[lane - 1];
                highs[lane] = highs[lane - 1];
            }
            behind = lows[lane] < behind ? lows[lane] : behind;
            ahead = highs[lane] > ahead ? highs[lane] : ahead;
        }
        if (ahead - behind >= MAX_WINDOW) return 1;
        slopes_of_rows(task, first, lows, highs, behind, ahead);
    }
    return 0;
}
