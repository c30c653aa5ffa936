/* What the kernels share. */

#ifndef ROBOT_ENERGY_KERNELS_H
#define ROBOT_ENERGY_KERNELS_H

#include <stddef.h>
#include <stdint.h>

#define LANES 8       /* samples that are computed side by side */
#define MAX_JOINTS 64 /* of a robot; with more, Pinocchio computes */
#define MAX_WINDOW 256 /* samples that a window and the rows beside it reach over */
#define NOT_A_NUMBER __builtin_nan("")
#define BODY_COLUMNS 27 /* of a row of the table of bodies, see read_chain */

/* Each function in a version per instruction set, chosen when the library is loaded; all give the
   same bits. */
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && defined(__linux__)
#define CLONES __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define CLONES
#endif

/* One number of each sample, and a whole number of each. */
typedef double lanes __attribute__((vector_size(8 * LANES)));
typedef int64_t whole __attribute__((vector_size(8 * LANES)));

#define INLINE static inline __attribute__((always_inline))

/* All bits where a number is negative, else none; compilers take comparisons of vectors apart. */
INLINE whole negative(whole number) { return number >> 63; }

/* A joint with the body that it moves. */
typedef struct {
    int parent;    /* 0 for the base, else the number of the joint before it from 1 on */
    int prismatic; /* else revolute */
    double turn[9], place[3]; /* of the joint's frame in that of its parent, matrix by rows */
    double mass, first_moment[3], inertia[9]; /* about the origin of the joint's frame */
} body;

typedef struct {
    int joints;
    double gravity[3];
    body bodies[MAX_JOINTS];
} chain;

/* Slopes at the rows from start to stop; everything else as in physics/derivative.py. */
typedef struct {
    const int64_t *stamp;          /* of all rows, rising [ns] */
    const double *time;            /* the same since the first [ns] */
    const double *values;          /* one column after the other */
    double *out;                   /* likewise, of the rows from start to stop */
    int64_t rows, columns, start, stop;
    int64_t behind_ns, ahead_ns;   /* reach of a window */
    int64_t least_behind, least_ahead; /* samples in it at least */
    double scale;                  /* unit of time in the fit [s] */
} slopes;

/* Messages of a block: channel, log time [ns], place and length of each, one table column after the
   other, and where the schemas and channels among them begin. */
typedef struct {
    int64_t *table, *others;
    int64_t room, others_room, limit; /* of messages, of others; messages to be found at most */
    int64_t count, others_count, end;
} messages;

void inverse_dynamics_lanes(const chain *tree, const double *q, const double *v,
                            const double *acc, double *tau);
int local_slopes(const slopes *task);
void messages_of(const uint8_t *data, uint64_t size, messages *found);
void exact_sum_of_column(const char *energy, int64_t stride, int64_t rows, int64_t *microjoule,
                         int64_t *remainder);

#endif
