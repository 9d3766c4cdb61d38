/* What rmw_cyclonedds has no call for: several messages in one datagram, each of which costs a way
 * through the kernel and wakes a thread of the reader; and publishers' GUIDs. Its call for a writer is
 * taken on its way: what a program itself defines is found before what libraries do. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <string.h>

#include "handles.h"
#include "layout.h"
#include "rcl.h"
#include "sending.h"

typedef int32_t entity; /* negative: an error */
typedef entity create_writer(entity parent, entity topic, const void *qos, const void *listener);
typedef void set_batch(bool enable);
typedef void write_flush(entity writer);
typedef int32_t get_guid(entity of, uint8_t guid[GID_BYTES]);

#define FAILED (-1) /* DDS_RETCODE_ERROR */

static _Thread_local bool making;
static _Thread_local entity last; /* 0: none */
static entity writers[PLAYER_ENDPOINTS]; /* 0: of another middleware */
/* Of the library that made them; NULL: it has no such function. */
static write_flush *_Atomic flush;
static get_guid *_Atomic guid_of;

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

/* Finds what the library of writers has for them; whether these can keep messages back. */
static set_batch *find_rest(create_writer *of) {
  void *library = library_of((void *)of);
  if (library == NULL) return NULL;
  set_batch *batch = (set_batch *)dlsym(library, "dds_write_set_batch");
  write_flush *sends = (write_flush *)dlsym(library, "dds_write_flush");
  guid_of = (get_guid *)dlsym(library, "dds_get_guid");
  dlclose(library);
  flush = batch == NULL ? NULL : sends;
  return flush == NULL ? NULL : batch;
}

__attribute__((visibility("default"))) entity dds_create_writer(entity parent, entity topic,
                                                                const void *qos,
                                                                const void *listener) {
  create_writer *create = find_create(__builtin_return_address(0));
  atomic_store(&holds_back, true);
  if (create == NULL) return FAILED;
  if (!making) return create(parent, topic, qos, listener);
  set_batch *batch = find_rest(create);
  /* It is for writers that are made from now on, and no writer of others is made meanwhile. */
  if (batch != NULL) batch(true);
  last = create(parent, topic, qos, listener);
  if (batch != NULL) batch(false);
  return last;
}

void cyclone_begin(void) {
  making = true;
  last = 0;
}

void cyclone_end(uint32_t slot, bool made) {
  making = false;
  writers[slot] = made && last > 0 ? last : 0;
}

void cyclone_flush(uint32_t slot) {
  if (writers[slot] != 0 && flush != NULL) flush(writers[slot]);
}

bool cyclone_made(uint32_t slot) { return writers[slot] != 0; }

bool cyclone_guid(uint32_t slot, uint8_t guid[GID_BYTES]) {
  return guid_of != NULL && guid_of(writers[slot], guid) == 0;
}

/* How the C library of Cyclone DDS describes a publisher. */
struct publication {
  uint8_t guid[GID_BYTES];
};
typedef struct publication *get_publication(entity reader, uint64_t handle);
typedef void free_publication(struct publication *);

/* What it has for subscriptions, by an address in the middleware; false if there is no such function. */
static bool find_for_readers(const char *of, get_publication **get, free_publication **give_back) {
  static get_publication *getter;
  static free_publication *freer;
  void *library = getter != NULL ? NULL : library_of((void *)of);
  if (library != NULL) {
    getter = (get_publication *)dlsym(library, "dds_get_matched_publication_data");
    freer = (free_publication *)dlsym(library, "dds_builtintopic_free_endpoint");
    dlclose(library);
  }
  *get = getter;
  *give_back = freer;
  return getter != NULL && freer != NULL;
}

void cyclone_publisher(const struct rmw_head *subscription, uint64_t handle,
                       uint8_t guid[GID_BYTES]) {
  get_publication *get;
  free_publication *give_back;
  if (handle_known(handle, guid) || subscription->data == NULL) return;
  if (!find_for_readers(subscription->implementation, &get, &give_back)) return;
  entity reader;
  /* It is what an endpoint's data begins with in each distribution. */
  memcpy(&reader, subscription->data, sizeof reader);
  struct publication *found = get(reader, handle);
  if (found == NULL) return;
  memcpy(guid, found->guid, GID_BYTES);
  give_back(found);
  handle_keep(handle, guid);
}
