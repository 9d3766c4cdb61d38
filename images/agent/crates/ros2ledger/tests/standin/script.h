/* What the scripted rmw has to do, and what it saw. */
#pragma once
#include <stdbool.h>
#include <stdint.h>

#include "rmw.h"

#define SETS 5
/* The thing of a set that a wait is for; the address means nothing else. */
#define THING(set, index) ((void *)(uintptr_t)(((set) + 1) << 20 | ((index) + 1)))

struct script {
  uint64_t act_at;  /* which call of rmw_wait it is, from 1, that gives the result; 0: none */
  int result;
  int set;          /* what is ready then: none if negative */
  uint64_t index;
  uint64_t pause_at; /* before this call the node asks whether to go on; 0: never */
  uint64_t late;     /* nanoseconds that each call needs more */
};
struct seen {
  uint64_t calls, spoilt; /* calls, and those whose sets were not whole */
  uint64_t longest, last; /* nanoseconds of the timeouts; UINT64_MAX: without end */
  uint64_t samples;       /* questions for matches */
};

void script_run(const struct script *script);
const struct seen *script_seen(void);
/* Nanoseconds of the clock that only waits move. */
uint64_t script_clock(void);
