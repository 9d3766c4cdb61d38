/* The player's shared memory: the same definition as src/layout.rs, which a test compares with it
 * field by field. Little-endian, native alignment, nothing but atomics before the rings. */
#pragma once
#include <stdatomic.h>
#include <stdint.h>

#define PLAYER_MAGIC 0x31594c5047474142ull /* "BAGGPLY1" */
#define PLAYER_VERSION 2u
#define PLAYER_ENDPOINTS 1024u /* of each kind */
#define PLAYER_STATES 64u      /* nodes whose state is asked for */
#define PLAYER_ALIGNMENT 32u   /* of a record in its ring */
#define PLAYER_RINGS 65536u    /* where the first ring begins: a page of any size */
#define GID_BYTES 16

enum record_kind {
  RECORD_MESSAGE,
  RECORD_PAD,       /* up to the end of the ring: what follows did not fit there */
  RECORD_TOO_LARGE, /* no message, since it is longer than half a ring; `stamp` has its length */
  RECORD_FAILED,    /* no message, but why the subscription gives none from now on */
};

/* What stands before each message. */
struct player_record {
  uint32_t length; /* of the bytes that follow */
  uint16_t endpoint;
  uint16_t kind;
  int64_t stamp; /* the source's, in ns since 1970; out: 0 */
  uint8_t publisher[GID_BYTES]; /* its GID, as the graph has it; 0s where that is not known, and out */
};

/* Bytes that were ever written and read; a futex for each side, which is 1 while it sleeps. */
struct player_ring {
  _Atomic uint64_t head;
  _Atomic uint32_t reader_sleeps;
  _Atomic uint32_t reserved_head[13];
  _Atomic uint64_t tail;
  _Atomic uint32_t writer_sleeps;
  _Atomic uint32_t reserved_tail[13];
};

struct player_publisher {
  _Atomic uint64_t published; /* the middleware took so many */
  _Atomic uint64_t refused;   /* and refused so many */
};

struct player_subscription {
  _Atomic uint64_t taken; /* and put into the ring */
  _Atomic uint64_t reserved;
};

struct player_header {
  _Atomic uint64_t magic;
  _Atomic uint32_t version;
  _Atomic uint32_t endpoints;
  _Atomic uint64_t room;    /* bytes of each ring, a power of two */
  _Atomic uint64_t refused; /* of all publishers */
  _Atomic uint64_t by_the_clock; /* whether messages are published when they are due: 0 or 1 */
  _Atomic uint64_t reserved[11];
  struct player_ring out;
  struct player_ring in;
  struct player_publisher publisher[PLAYER_ENDPOINTS];
  struct player_subscription subscription[PLAYER_ENDPOINTS];
};

_Static_assert(sizeof(struct player_record) == PLAYER_ALIGNMENT, "one unit");
_Static_assert(sizeof(struct player_ring) == 128, "a line of cache for each side");
_Static_assert(sizeof(struct player_header) <= PLAYER_RINGS, "the rings are behind");
