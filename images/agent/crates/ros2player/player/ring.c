#define _GNU_SOURCE
#include "ring.h"

#include <linux/futex.h>
#include <limits.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

/* No wait is longer, so that a lost wake costs no more than this. */
#define SLICE_NS 100000000

struct player_header *memory;
_Atomic int ending;

static uint64_t room;
static uint64_t out_tail, out_length, in_head; /* our own sides: not read back */

static uint64_t padded(uint64_t length) {
  return (length + PLAYER_ALIGNMENT - 1) & ~(uint64_t)(PLAYER_ALIGNMENT - 1);
}

static uint8_t *at(uint64_t ring, uint64_t position) {
  return (uint8_t *)memory + PLAYER_RINGS + ring * room + (position & (room - 1));
}

const char *ring_open(int file) {
  off_t length = lseek(file, 0, SEEK_END);
  if (length < (off_t)PLAYER_RINGS) return "it is too short";
  memory = mmap(NULL, (size_t)length, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  if (memory == MAP_FAILED) return "it can't be mapped";
  room = atomic_load(&memory->room);
  if (atomic_load(&memory->magic) != PLAYER_MAGIC) return "it is no memory of a player";
  if (atomic_load(&memory->version) != PLAYER_VERSION) return "it is of another version";
  if (room < PLAYER_ALIGNMENT || (room & (room - 1)) != 0) return "its rings have no such size";
  if ((uint64_t)length != PLAYER_RINGS + 2 * room) return "it is not as long as it says";
  return NULL;
}

size_t ring_most(void) { return room / 2 - sizeof(struct player_record); }

/* Sleeps while `sleeps` is 1, at the most for a slice. */
static void sleep_on(_Atomic uint32_t *sleeps) {
  struct timespec limit = {0, SLICE_NS};
  syscall(SYS_futex, sleeps, FUTEX_WAIT, 1, &limit, NULL, 0);
}

static void wake(_Atomic uint32_t *sleeps) {
  if (atomic_load(sleeps) == 0 || atomic_exchange(sleeps, 0) == 0) return;
  syscall(SYS_futex, sleeps, FUTEX_WAKE, INT_MAX, NULL, NULL, 0);
}

void ring_wake(void) {
  if (memory == NULL) return;
  wake(&memory->out.reader_sleeps);
  wake(&memory->in.writer_sleeps);
}

/* How many bytes of `out` are to be read; waits until there are some. 0 at the end. */
static uint64_t out_waiting(void) {
  struct player_ring *out = &memory->out;
  while (!atomic_load(&ending)) {
    uint64_t waiting = atomic_load(&out->head) - out_tail;
    if (waiting != 0) return waiting;
    atomic_store(&out->reader_sleeps, 1);
    if (atomic_load(&out->head) == out_tail) sleep_on(&out->reader_sleeps);
    atomic_store(&out->reader_sleeps, 0);
  }
  return 0;
}

const struct player_record *out_next(const uint8_t **bytes) {
  static struct player_record record; /* a copy: others may write the ring meanwhile */
  for (;;) {
    uint64_t waiting = out_waiting();
    if (waiting < sizeof(struct player_record) || waiting > room) return NULL;
    uint64_t behind = room - (out_tail & (room - 1)); /* up to the end of the ring */
    memcpy(&record, at(0, out_tail), sizeof record);
    atomic_signal_fence(memory_order_seq_cst); /* what is compared is this copy */
    out_length = sizeof record + padded(record.length);
    if (out_length > waiting || out_length > behind) return NULL;
    *bytes = at(0, out_tail) + sizeof record;
    if (record.kind != RECORD_PAD) return &record;
    out_done();
  }
}

bool out_follows(uint16_t endpoint) {
  struct player_record record;
  uint64_t behind = out_tail + out_length;
  if (atomic_load(&memory->out.head) - behind < sizeof record) return false;
  memcpy(&record, at(0, behind), sizeof record);
  return record.kind == RECORD_MESSAGE && record.endpoint == endpoint;
}

void out_done(void) {
  struct player_ring *out = &memory->out;
  out_tail += out_length;
  atomic_store(&out->tail, out_tail);
  /* A writer that waits for room gets much at once, instead of a wake for each record. */
  if (atomic_load(&out->head) - out_tail <= room / 2) wake(&out->writer_sleeps);
}

/* Waits until so many bytes are free in `in`. */
static bool in_room(uint64_t wanted) {
  struct player_ring *in = &memory->in;
  while (!atomic_load(&ending)) {
    if (in_head - atomic_load(&in->tail) + wanted <= room) return true;
    atomic_store(&in->writer_sleeps, 1);
    if (in_head - atomic_load(&in->tail) + wanted > room) sleep_on(&in->writer_sleeps);
    atomic_store(&in->writer_sleeps, 0);
  }
  return false;
}

bool in_write(struct player_record record, const void *bytes) {
  struct player_ring *in = &memory->in;
  uint64_t whole = sizeof record + padded(record.length);
  uint64_t behind = room - (in_head & (room - 1));
  uint64_t padding = whole > behind ? behind : 0;
  if (!in_room(whole + padding)) return false;
  if (padding != 0) {
    struct player_record pad = {.length = (uint32_t)(padding - sizeof pad), .kind = RECORD_PAD};
    memcpy(at(1, in_head), &pad, sizeof pad);
  }
  uint8_t *place = at(1, in_head + padding);
  memcpy(place, &record, sizeof record);
  if (record.length != 0) memcpy(place + sizeof record, bytes, record.length);
  in_head += padding + whole;
  atomic_store(&in->head, in_head);
  wake(&in->reader_sleeps);
  return true;
}
