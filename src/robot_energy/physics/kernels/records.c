/* Messages of a block of MCAP records, one after another; see bag/mcap_records.py. */

#include <string.h>

#include "kernels.h"

enum { SCHEMA = 3, CHANNEL = 4, MESSAGE = 5, FRAME = 9, MESSAGE_FIXED = 22 };

/* Little-endian, as in the file, whatever the machine. */
static uint64_t number(const uint8_t *from, int bytes) {
    uint64_t value = 0;
    for (int i = bytes - 1; i >= 0; i--) value = value << 8 | from[i];
    return value;
}

void messages_of(const uint8_t *data, uint64_t size, messages *found) {
    uint64_t pos = 0;
    found->count = found->others_count = 0;
    while (size - pos >= FRAME && found->count < found->limit) {
        unsigned kind = data[pos];
        uint64_t length = number(data + pos + 1, 8), body = pos + FRAME;
        if ((kind != MESSAGE && kind != SCHEMA && kind != CHANNEL) || length > size - body) break;
        if (kind == MESSAGE) {
            if (length < MESSAGE_FIXED) break;
            int64_t *column = found->table + found->count++;
            column[0] = (int64_t)number(data + body, 2);
            column[found->room] = (int64_t)number(data + body + 6, 8);
            column[2 * found->room] = (int64_t)(body + MESSAGE_FIXED);
            column[3 * found->room] = (int64_t)(length - MESSAGE_FIXED);
        } else {
            if (found->others_count == found->others_room) break;
            found->others[found->others_count++] = (int64_t)pos;
        }
        pos = body + length;
    }
    found->end = (int64_t)pos;
}
