/* By which number a publisher is in the graph, whatever its node's name. */
#pragma once
#include <stdbool.h>
#include <stdint.h>

#include "list.h"

#define GID_BYTES 16

/* False where the middleware does not say, or where it was not shown that the graph has the same. */
bool gid_of_publisher(const struct endpoint_head *publisher, uint8_t gid[GID_BYTES]);
