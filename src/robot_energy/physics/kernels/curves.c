/* Energies of two power curves over the intervals on which both are known, cut at every edge of
   either; see accounting/comparison.py. */

#include "kernels.h"

#define NEVER INT64_MAX

/* Where a curve stands: its newest piece that begins no later than a time. */
typedef struct {
    const pieces *curve;
    int64_t row, next; /* piece; first piece that begins later */
} cursor;

static void advance(cursor *at, int64_t time) {
    const pieces *curve = at->curve;
    while (at->next < curve->count && curve->start[at->next] <= time) at->next++;
    at->row = at->next ? at->next - 1 : 0;
}

/* First edge after a time: the end of the piece, or where the next one begins. */
static int64_t edge_after(const cursor *at, int64_t time) {
    const pieces *curve = at->curve;
    int64_t edge = at->next < curve->count ? curve->start[at->next] : NEVER;
    if (curve->end[at->row] > time && curve->end[at->row] < edge) edge = curve->end[at->row];
    return edge;
}

static int covers(const cursor *at, int64_t begin, int64_t end) {
    return at->curve->start[at->row] <= begin && end <= at->curve->end[at->row];
}

static double power_at(const cursor *at, int64_t time) {
    const pieces *curve = at->curve;
    int64_t start = curve->start[at->row];
    double low = curve->start_power[at->row];
    double share = (double)(time - start) / (double)(curve->end[at->row] - start);
    return low + (curve->end_power[at->row] - low) * share;
}

int64_t compare_curves(const pieces *measured, const pieces *predicted, int64_t start,
                       int64_t until, int64_t *available, int64_t *duration, double *energy,
                       int64_t room) {
    cursor m = {measured, 0, 0}, p = {predicted, 0, 0};
    int64_t found = 0;
    for (int64_t time = start; time < until;) {
        advance(&m, time);
        advance(&p, time);
        int64_t edge = edge_after(&m, time), other = edge_after(&p, time);
        edge = other < edge ? other : edge;
        edge = until < edge ? until : edge;
        if (covers(&m, time, edge) && covers(&p, time, edge)) {
            if (found == room) return -1;
            double half = 0.5 * 1e-9 * (double)(edge - time);
            available[found] = measured->end[m.row];
            duration[found] = edge - time;
            energy[found] = (power_at(&m, time) + power_at(&m, edge)) * half;
            energy[room + found] = (power_at(&p, time) + power_at(&p, edge)) * half;
            found++;
        }
        time = edge;
    }
    return found;
}
