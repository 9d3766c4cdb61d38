/* What the C library of Cyclone DDS says that rmw_cyclonedds does not. */
#pragma once
#include <stdbool.h>
#include <stdint.h>

#include "list.h"

bool is_cyclone(const char *implementation);
/* A function of the library that rmw_cyclonedds uses, or NULL. */
void *cyclone_function(const char *name);
/* An endpoint's number there; false if it has none. */
bool cyclone_entity(const struct endpoint_head *endpoint, int32_t *entity);
