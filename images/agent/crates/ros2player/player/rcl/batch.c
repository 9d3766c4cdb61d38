/* Several messages in one datagram, over Cyclone DDS: each datagram costs a way through the kernel, and
 * wakes a thread of the reader. rmw_cyclonedds has no such setting, so its call for a writer is taken
 * on its way: what a program itself defines is found before what libraries do. */
#define _GNU_SOURCE
#include <dlfcn.h>

#include "layout.h"
#include "rcl.h"

typedef int32_t entity; /* negative: an error */
typedef entity create_writer(entity parent, entity topic, const void *qos, const void *listener);
typedef void set_batch(bool enable);
typedef void write_flush(entity writer);

#define FAILED (-1) /* DDS_RETCODE_ERROR */

static _Thread_local bool making;
static _Thread_local entity last; /* 0: none */
static entity writers[PLAYER_ENDPOINTS]; /* 0: it keeps nothing back */
static write_flush *_Atomic flush; /* of the library that made them */

/* The library that holds an address, as the process has it. */
static void *library_of(void *address) {
  Dl_info info;
  if (dladdr(address, &info) == 0) return NULL;
  return dlopen(info.dli_fname, RTLD_NOW | RTLD_NOLOAD);
}

/* What a library that calls for a writer would have found without ours: that of the libraries that
 * it is linked to, or else of all. */
static create_writer *find_create(void *caller) {
  void *library = library_of(caller);
  void *found = library == NULL ? NULL : dlsym(library, "dds_create_writer");
  if (library != NULL) dlclose(library);
  return (create_writer *)(found != NULL ? found : dlsym(RTLD_NEXT, "dds_create_writer"));
}

/* Whether writers that a library makes can keep messages back, and how they are sent then. */
static bool find_batches(create_writer *of, set_batch **batch, write_flush **sends) {
  void *library = library_of((void *)of);
  if (library == NULL) return false;
  *batch = (set_batch *)dlsym(library, "dds_write_set_batch");
  *sends = (write_flush *)dlsym(library, "dds_write_flush");
  dlclose(library);
  return *batch != NULL && *sends != NULL;
}

__attribute__((visibility("default"))) entity dds_create_writer(entity parent, entity topic,
                                                                const void *qos,
                                                                const void *listener) {
  create_writer *create = find_create(__builtin_return_address(0));
  set_batch *batch;
  write_flush *sends;
  if (create == NULL) return FAILED;
  if (!making || !find_batches(create, &batch, &sends)) return create(parent, topic, qos, listener);
  /* It is for writers that are made from now on, and no writer of others is made meanwhile. */
  batch(true);
  last = create(parent, topic, qos, listener);
  batch(false);
  flush = sends;
  return last;
}

void batch_begin(void) {
  making = true;
  last = 0;
}

void batch_end(uint32_t slot, bool made) {
  making = false;
  writers[slot] = made && last > 0 ? last : 0;
}

void batch_send(uint32_t slot) {
  if (writers[slot] != 0) flush(writers[slot]);
}
