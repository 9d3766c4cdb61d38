/* What participants of ROS 2 announce of their nodes by the topic ros_discovery_info: which endpoints each
 * has. None of it is trusted: what can't be parsed is no node. */
#pragma once
#include <dds/dds.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define DISCOVERY_TOPIC "ros_discovery_info"

/* Numbers of endpoints, one behind the other, of which the first 16 bytes are a DDS GUID. */
struct guids {
  const uint8_t *bytes;
  size_t count, size; /* of one */
};

struct announced_node {
  const char *space, *name;
  struct guids readers, writers;
};

bool guids_have(const struct guids *of, const dds_guid_t *wanted);

typedef void visit_node(const struct announced_node *node, void *state);

/* Visits the nodes in a serialised message of this topic; false if it can't be one. */
bool nodes_parse(const uint8_t *bytes, size_t length, dds_guid_t *participant, visit_node *visitor,
                 void *state);

/* Takes in what came since the last call. */
void nodes_refresh(void);

/* Visits the nodes of a participant; false if it has announced none. */
bool nodes_of(const dds_guid_t *participant, visit_node *visitor, void *state);

/* Forgets who is not `alive`. */
void nodes_forget(bool (*alive)(const dds_guid_t *participant, void *state), void *state);
