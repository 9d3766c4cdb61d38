#include "gid.h"

#include <stdatomic.h>
#include <stddef.h>
#include <string.h>

#include "cyclone.h"
#include "next.h"

/* How rmw_gid_t begins; it is longer until Humble. */
struct gid {
  const char *implementation;
  uint8_t bytes[GID_BYTES];
  uint8_t rest[64];
};
typedef int get_gid(const void *publisher, struct gid *into);
typedef int32_t get_guid(int32_t entity, uint8_t guid[GID_BYTES]);

/* Whether rmw's number of a publisher is the graph's: where this was not run it is not believed. */
static bool is_of_graph(const char *implementation) {
  static const char *const those[] = {"rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp"};
  for (size_t one = 0; implementation != NULL && one < sizeof those / sizeof *those; one++)
    if (strcmp(implementation, those[one]) == 0) return true;
  return false;
}

/* In Cyclone DDS rmw's is a number of this process, and the graph has the GUID. */
static bool guid_in_cyclone(const struct endpoint_head *publisher, uint8_t gid[GID_BYTES]) {
  static get_guid *_Atomic getter;
  int32_t entity;
  get_guid *get = atomic_load(&getter);
  if (get == NULL) atomic_store(&getter, get = (get_guid *)cyclone_function("dds_get_guid"));
  return get != NULL && cyclone_entity(publisher, &entity) && get(entity, gid) == 0;
}

bool gid_of_publisher(const struct endpoint_head *publisher, uint8_t gid[GID_BYTES]) {
  if (is_cyclone(publisher->implementation)) return guid_in_cyclone(publisher, gid);
  if (!is_of_graph(publisher->implementation)) return false;
  static get_gid *_Atomic getter;
  get_gid *get = atomic_load(&getter);
  if (get == NULL) {
    get = (get_gid *)next_function("rmw_get_gid_for_publisher", "librmw_implementation.so");
    atomic_store(&getter, get);
  }
  struct gid found;
  if (get == NULL || get(publisher, &found) != 0) return false;
  memcpy(gid, found.bytes, GID_BYTES);
  return true;
}
