/* The two rings, as the program has them: it reads `out`, whose messages it publishes where they
 * stand, and writes `in`. What others may have written there never leads out of the memory. */
#pragma once
#include <stdbool.h>
#include <stddef.h>

#include "layout.h"

extern struct player_header *memory;
extern _Atomic int ending; /* the program ends: nobody waits any more */

/* Maps the memory; NULL, or a sentence's end. */
const char *ring_open(int file);

/* The next record of `out` that is not padding, valid until the next, and its bytes; waits for it.
 * NULL at the end, or where what stands there can't be. */
const struct player_record *out_next(const uint8_t **bytes);

/* Whether a message of this endpoint stands right behind what `out_next` returned. */
bool out_follows(uint16_t endpoint);

/* Gives the room of what `out_next` returned back. */
void out_done(void);

/* Puts a record into `in`, with as many bytes as it has; waits for room. False at the end. */
bool in_write(struct player_record record, const void *bytes);

/* The longest message that a ring takes. */
size_t ring_most(void);

/* Wakes whoever of this program waits for a ring. */
void ring_wake(void);
