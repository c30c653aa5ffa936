/* Columns of numbers out of serialised messages of one layout; see bag/cdr/decode.py. */

#include <string.h>

#include "kernels.h"

/* Copy the numbers of one message, each to its own column. */
#define COPY(type)                                                                         \
    for (int64_t number = 0; number < column->count; number++)                             \
        memcpy((type *)column->out + number * rows + row,                                  \
               data + column->place + number * (int64_t)sizeof(type), sizeof(type));

int64_t take_columns(const uint8_t *buffer, const int64_t *offset, int64_t rows,
                     const layout *known) {
    for (int64_t row = 0; row < rows; row++) {
        const uint8_t *data = buffer + offset[row];
        for (int64_t span = 0; span < known->spans; span++) {
            int64_t start = known->starts[span];
            if (memcmp(data + start, known->key + start, (size_t)(known->stops[span] - start)))
                return row;
        }
        for (int64_t place = 0; place < known->columns; place++) {
            const numbers *column = &known->column[place];
            switch (column->size) {
            case 1: COPY(uint8_t) break;
            case 2: COPY(uint16_t) break;
            case 4: COPY(uint32_t) break;
            default: COPY(uint64_t) break;
            }
        }
    }
    return rows;
}
