/* Energies behind the registers of a robot, interval by interval, and their exact sums; see
   accounting/registers.py. Every column is read and written once, a part of the rows after the
   other, so that all of it stays in the cache. */

#include "kernels.h"

#define PART 1024

/* Powers of one column at rows from start on. */
static void powers_at(const registers *task, int64_t column, int64_t start, int64_t count,
                      double *power) {
    const double *grid = task->cabinet[0] + start;
    if (column == 0)
        for (int64_t i = 0; i < count; i++) power[i] = grid[i] < 0.0 ? 0.0 : grid[i];
    else if (column == 1)
        for (int64_t i = 0; i < count; i++) power[i] = grid[i] > 0.0 ? 0.0 : -grid[i];
    else if (column < CABINET_COLUMNS)
        __builtin_memcpy(power, task->cabinet[column - 1] + start, (size_t)count * 8);
    else {
        int64_t kind = (column - CABINET_COLUMNS) / task->joints;
        int64_t place = (column - CABINET_COLUMNS) % task->joints * task->rows + start;
        const double *rigid = task->joint[0] + place, *friction = task->joint[1] + place;
        if (kind == 0)
            for (int64_t i = 0; i < count; i++) {
                double shaft = rigid[i] + friction[i];
                power[i] = shaft < 0.0 ? 0.0 : shaft;
            }
        else if (kind == 1)
            for (int64_t i = 0; i < count; i++) {
                double shaft = rigid[i] + friction[i];
                power[i] = (shaft < 0.0 ? 0.0 : shaft) - shaft;
            }
        else
            __builtin_memcpy(power, task->joint[kind - 2] + place, (size_t)count * 8);
    }
}

/* Energies of intervals that end at rows; the greatest amount so far, in each lane. */
INLINE lanes trapezoids(const double *power, const double *half, int64_t count, double *energy,
                        lanes peak) {
    for (int64_t i = 0; i < count; i += LANES) {
        lanes now, before, share;
        int64_t whole_lanes = count - i < LANES ? count - i : LANES;
        __builtin_memcpy(&now, power + 1 + i, sizeof now);
        __builtin_memcpy(&before, power + i, sizeof before);
        __builtin_memcpy(&share, half + i, sizeof share);
        lanes found = (now + before) * share;
        for (int64_t lane = whole_lanes; lane < LANES; lane++) found[lane] = 0.0;
        if (whole_lanes == LANES) __builtin_memcpy(energy + i, &found, sizeof found);
        else
            for (int64_t lane = 0; lane < whole_lanes; lane++) energy[i + lane] = found[lane];
        /* bits of amounts rise with them, and those of NaN lie above all */
        whole amount = (whole)found & INT64_MAX, most = (whole)peak;
        whole more = negative(most - amount);
        peak = (lanes)((amount & more) | (most & ~more));
    }
    return peak;
}

/* Return whether no energy is NaN or beyond what counts; else nothing written is of use. */
CLONES int integrate_registers(const registers *task) {
    double power[PART + 1 + LANES] = {0}, half[PART + LANES] = {0};
    int64_t columns = CABINET_COLUMNS + JOINT_COLUMNS * task->joints;
    lanes peak = {0};
    for (int64_t column = 0; column < columns; column++) {
        double *energy = column < task->kept ? task->energy + column * task->rows : task->scratch;
        power[0] = task->before[column];
        for (int64_t start = 0; start < task->rows; start += PART) {
            int64_t count = task->rows - start < PART ? task->rows - start : PART;
            powers_at(task, column, start, count, power + 1);
            __builtin_memcpy(half, task->half + start, (size_t)count * 8);
            peak = trapezoids(power, half, count, energy + start, peak);
            power[0] = power[count];
        }
        task->last[column] = power[0];
        for (int lane = 0; lane < LANES; lane++)
            if (!(peak[lane] <= MAX_ENERGY)) return 0;
        exact_sum_of_column((const char *)energy, 8, task->rows, task->microjoule + column,
                            task->remainder + column);
    }
    return 1;
}
