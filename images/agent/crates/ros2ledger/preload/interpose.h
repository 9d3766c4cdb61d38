/* How an interposed function finds the one that it stands before. */
#pragma once
#include <stdatomic.h>

#include "next.h"

#define PUBLIC __attribute__((visibility("default")))

/* `next`: the function of this name, looked up once; `missing` is returned where there is none. */
#define NEXT(name, library, missing)                          \
  static __typeof__(name) *_Atomic known_##name;              \
  __typeof__(name) *next = atomic_load(&known_##name);        \
  if (next == NULL) {                                         \
    next = (__typeof__(name) *)next_function(#name, library); \
    if (next == NULL) return missing;                         \
    atomic_store(&known_##name, next);                        \
  }
