/* How far a meter with a low pass shows each power behind it, and the greatest of the newest times;
   see accounting/late_meter.py. */

#include <math.h>

#include "kernels.h"

#define NANOWATT 1e9
#define MOST 9e18 /* that an integer holds */

void follow_late(const late *task) {
    double last = task->state[0], behind = task->state[1];
    int64_t before = task->before, first = 0, stop = task->kept;
    int64_t *stamps = task->stamps, *lates = task->lates; /* room for all, the kept ones first */
    for (int64_t row = 0; row < task->rows; row++) {
        int64_t stamp = task->stamp[row];
        double power = task->power[row], constant = task->constant[row];
        if (constant > 0.0 && before != NO_STAMP) {
            double passed = (double)(stamp - before) * 1e-9;
            behind = behind * exp(-passed / constant) + (last - power);
        } else
            behind = 0.0;
        last = power;
        before = stamp;
        int64_t now = (int64_t)fmin(rint(fabs(behind) * NANOWATT), MOST);
        while (stop > first && lates[stop - 1] <= now) stop--;
        stamps[stop] = stamp;
        lates[stop++] = now;
        while (stamps[first] <= stamp - task->recent_ns) first++;
        task->most[row] = lates[first];
    }
    task->state[0] = last;
    task->state[1] = behind;
    task->range[0] = first;
    task->range[1] = stop;
}
