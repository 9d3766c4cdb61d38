/* What the parts of the stand-in's rmw have in common. */
#pragma once
#include <dds/dds.h>
#include <stdlib.h>
#include <string.h>

#include "rmw.h"

/* Publishers and handles are as in that one. */
#define IDENTIFIER "rmw_cyclonedds_cpp"

/* A node is a DDS participant, whose user data is its name and namespace. */
struct node {
  dds_entity_t participant;
  dds_entity_t participants, publications, subscriptions; /* readers of who is in the graph */
};

struct endpoint {
  dds_entity_t entity, topic, condition; /* the first is where rmw_cyclonedds_cpp has it */
  const void *type; /* what messages are made with */
  struct rmw_qos qos;
  dds_time_t meets; /* a publisher knows nobody before */
  dds_duration_t returns_late; /* a publisher sleeps for so long after its message went out */
};

/* Whether a variable of the environment has this value. */
static inline bool is_set(const char *variable, const char *value) {
  const char *set = getenv(variable);
  return set != NULL && strcmp(set, value) == 0;
}

/* More than a graph of tests has. */
#define MOST_ENTITIES 4096
