/* What the parts of the player on DDS alone have in common. */
#pragma once
#include <dds/dds.h>

#include "layout.h"
#include "middleware.h"

extern dds_entity_t participant;

/* Answers that a function of DDS has failed; so that it can be returned, false. */
bool answer_dds(struct answer *into, const char *function, dds_return_t failed);

/* endpoints.c */
dds_entity_t subscription_condition(uint32_t slot);

/* wait.c: what wakes who waits; false with an answer if it is not to be had. */
bool wait_prepare(struct answer *into);

/* graph.c, nodes.c: readers of who is there; as above. */
bool graph_prepare(struct answer *into);
bool nodes_prepare(struct answer *into);
