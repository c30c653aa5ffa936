/* What the kernels share. */

#ifndef ROBOT_ENERGY_KERNELS_H
#define ROBOT_ENERGY_KERNELS_H

#include <stddef.h>
#include <stdint.h>

#define LANES 8       /* samples that are computed side by side */
#define MAX_JOINTS 64 /* of a robot; with more, Pinocchio computes */
#define MAX_WINDOW 256 /* samples that a window and the rows next to it reach over */
#define MOST_TIME (INT64_C(1) << 62) /* two times below it differ by what 64 bits hold [ns] */
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

#define CABINET_COLUMNS 6 /* of registers: drawn and given grid power, and four losses */
#define JOINT_COLUMNS 5   /* the same of each joint: shaft, drawn and given; three parts */
#define MAX_ENERGY 2e6    /* of an interval, which sums exactly [J] */

/* Powers of a block, and what becomes of them; matrices one column after the other. */
typedef struct {
    int64_t rows, joints, kept;                 /* kept: columns whose energies are written */
    const double *cabinet[CABINET_COLUMNS - 1]; /* grid, brake, loss_dc, loss_grid, capacitor */
    const double *joint[JOINT_COLUMNS - 2];     /* rigid, friction, drive loss */
    const double *before, *half;                /* powers of the row before; half of each time */
    double *last, *energy, *scratch;            /* powers of the last row; energies; one column */
    int64_t *microjoule, *remainder;            /* sums to be added to */
} registers;

/* Straight pieces of a power curve in time order. */
typedef struct {
    const int64_t *start, *end;
    const double *start_power, *end_power;
    int64_t count;
} pieces;

#define MAX_COLUMNS 32 /* fields of a message that are taken together */

/* Numbers of a field: where they lie in a message, and where they go, one column after the other. */
typedef struct {
    int64_t place, size, count; /* first byte; bytes of a number; numbers */
    void *out;
} numbers;

/* What all messages of a layout share, and what is taken from them. */
typedef struct {
    const uint8_t *key;            /* a message; only its spans count */
    const int64_t *starts, *stops; /* of the bytes that must be those of the key */
    int64_t spans, columns;
    numbers column[MAX_COLUMNS];
} layout;

void inverse_dynamics_lanes(const chain *tree, const double *q, const double *v,
                            const double *acc, double *tau);
int local_slopes(const slopes *task);
void messages_of(const uint8_t *data, uint64_t size, messages *found);
int64_t take_columns(const uint8_t *buffer, const int64_t *offset, int64_t rows,
                     const layout *known); /* the first row that does not agree */
int integrate_registers(const registers *task);
int64_t compare_curves(const pieces *measured, const pieces *predicted, int64_t start,
                       int64_t until, int64_t *available, int64_t *duration, double *energy,
                       int64_t room);
void exact_sum_of_column(const char *energy, int64_t stride, int64_t rows, int64_t *microjoule,
                         int64_t *remainder);

#endif
