/* The GUIDs of publishers by the handles that a process has of them in Cyclone DDS, which gives none twice.
 * The thread that takes is the only one here. */
#pragma once
#include <stdbool.h>
#include <stdint.h>

#include "layout.h"

/* What one is known by; false where it was not kept. */
bool handle_known(uint64_t handle, uint8_t guid[GID_BYTES]);

/* Keeps it, as long as there is room: who has left is asked for in vain. */
void handle_keep(uint64_t handle, const uint8_t guid[GID_BYTES]);
