#include "cyclone.h"

#include <stddef.h>
#include <string.h>

#include "next.h"

#define CYCLONE "rmw_cyclonedds_cpp"

bool is_cyclone(const char *implementation) {
  return implementation != NULL && strcmp(implementation, CYCLONE) == 0;
}

void *cyclone_function(const char *name) {
  /* Its libraries are those of the implementation, however these were loaded. */
  void *found = next_function(name, "lib" CYCLONE ".so");
  return found != NULL ? found : next_function(name, "librmw_implementation.so");
}

/* It is what an endpoint's data begins with in each distribution. */
bool cyclone_entity(const struct endpoint_head *endpoint, int32_t *entity) {
  if (endpoint->data == NULL) return false;
  memcpy(entity, endpoint->data, sizeof *entity);
  return true;
}
