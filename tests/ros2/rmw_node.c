/* Nodes, and the graph as one of them sees it. */
#define _GNU_SOURCE
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "loopback.h"
#include "rmw_parts.h"

int rmw_init(const void *options, struct rmw_context *context) {
  (void)options;
  const char *domain = getenv("ROS_DOMAIN_ID");
  char *end = "";
  context->implementation = IDENTIFIER;
  context->domain = domain == NULL ? 0 : strtoul(domain, &end, 10);
  if (*end != 0 || context->domain > 232)
    return standin_error(RMW_ERROR, "ROS_DOMAIN_ID is not a domain: %s", domain);
  context->entity = loopback_domain((dds_domainid_t)context->domain);
  if (context->entity < 0)
    return standin_error(RMW_ERROR, "no DDS domain: %s", dds_strretcode(context->entity));
  return RMW_OK;
}

/* What nodes have left is sent before the domain is gone: that they left, too. */
int rmw_context_fini(struct rmw_context *context) {
  dds_delete(context->entity);
  context->implementation = NULL;
  return RMW_OK;
}

struct rmw_node *rmw_create_node(struct rmw_context *context, const char *name, const char *space) {
  if (is_set("ROS_SECURITY_ENABLE", "true") && is_set("ROS_SECURITY_STRATEGY", "Enforce")) {
    /* As ROS 2's own does: what is wrong is on standard error alone. */
    fprintf(stderr, "Security was requested, and this DDS has none\n");
    standin_error(RMW_ERROR, "error not set");
    return NULL;
  }
  struct rmw_node *made = calloc(1, sizeof *made);
  struct node *node = calloc(1, sizeof *node);
  char user_data[1024];
  int length = snprintf(user_data, sizeof user_data, "name=%s;namespace=%s;", name, space);
  dds_qos_t *qos = dds_create_qos();
  dds_qset_userdata(qos, user_data, (size_t)length);
  node->participant = dds_create_participant((dds_domainid_t)context->domain, qos, NULL);
  dds_delete_qos(qos);
  if (node->participant < 0) {
    standin_error(RMW_ERROR, "no DDS participant: %s", dds_strretcode(node->participant));
    return NULL;
  }
  node->participants =
      dds_create_reader(node->participant, DDS_BUILTIN_TOPIC_DCPSPARTICIPANT, NULL, NULL);
  node->publications =
      dds_create_reader(node->participant, DDS_BUILTIN_TOPIC_DCPSPUBLICATION, NULL, NULL);
  node->subscriptions =
      dds_create_reader(node->participant, DDS_BUILTIN_TOPIC_DCPSSUBSCRIPTION, NULL, NULL);
  *made = (struct rmw_node){IDENTIFIER, node, strdup(name), strdup(space), context};
  return made;
}

int rmw_destroy_node(struct rmw_node *node) {
  dds_delete(((struct node *)node->data)->participant);
  free(node->data);
  free((char *)node->name);
  free((char *)node->space);
  free(node);
  return RMW_OK;
}

/* The part of user data behind `key`, up to the semicolon; false if there is none. */
static bool part_of(const char *data, const char *key, char into[512]) {
  const char *found = strstr(data, key);
  const char *end = found == NULL ? NULL : strchr(found, ';');
  if (end == NULL) return false;
  found += strlen(key);
  snprintf(into, 512, "%.*s", (int)(end - found), found);
  return true;
}

/* Name and namespace of a participant; false if it is no node. */
static bool node_of(const dds_builtintopic_participant_t *one, char name[512], char space[512]) {
  void *data = NULL;
  size_t length;
  if (!dds_qget_userdata(one->qos, &data, &length) || data == NULL) return false;
  char text[1024];
  snprintf(text, sizeof text, "%.*s", (int)length, (char *)data);
  dds_free(data);
  return part_of(text, "name=", name) && part_of(text, "namespace=", space);
}

typedef void visit(const void *sample, void *state);

/* Visits all that a reader of the graph knows to be there. */
static void each(dds_entity_t reader, visit *visitor, void *state) {
  static pthread_mutex_t one_at_a_time = PTHREAD_MUTEX_INITIALIZER;
  static dds_sample_info_t infos[MOST_ENTITIES];
  static void *samples[MOST_ENTITIES];
  pthread_mutex_lock(&one_at_a_time);
  samples[0] = NULL;
  int count = dds_read(reader, samples, infos, MOST_ENTITIES, MOST_ENTITIES);
  for (int at = 0; at < count; at++)
    if (infos[at].valid_data && infos[at].instance_state == DDS_IST_ALIVE)
      visitor(samples[at], state);
  if (count > 0) dds_return_loan(reader, samples, count);
  pthread_mutex_unlock(&one_at_a_time);
}

struct names {
  struct strings *names, *spaces;
};

static void add_name(const void *sample, void *state) {
  struct names *into = state;
  char name[512], space[512];
  if (!node_of(sample, name, space)) return;
  standin_add(into->names, name);
  standin_add(into->spaces, space);
}

int rmw_get_node_names(const struct rmw_node *node, struct strings *names, struct strings *spaces) {
  struct names into = {names, spaces};
  each(((const struct node *)node->data)->participants, add_name, &into);
  return RMW_OK;
}

struct search {
  const char *name, *space; /* of a node; NULL: of all */
  dds_guid_t participant;
  bool found;
  struct names_and_types *into;
};

static void find_participant(const void *sample, void *state) {
  const dds_builtintopic_participant_t *one = sample;
  struct search *search = state;
  char name[512], space[512];
  if (!node_of(one, name, space)) return;
  if (strcmp(name, search->name) != 0 || strcmp(space, search->space) != 0) return;
  search->participant = one->key;
  search->found = true;
}

/* The ROS name of a type `package::msg::dds_::Name_`. */
static void demangle(const char *type, char into[512]) {
  char package[256], folder[256], name[256];
  if (sscanf(type, "%255[^:]::%255[^:]::dds_::%255s", package, folder, name) != 3) {
    snprintf(into, 512, "%s", type);
    return;
  }
  name[strlen(name) - 1] = 0;
  snprintf(into, 512, "%.160s/%.160s/%.160s", package, folder, name);
}

static void add_topic(const void *sample, void *state) {
  const dds_builtintopic_endpoint_t *one = sample;
  struct search *search = state;
  struct names_and_types *into = search->into;
  char type[512];
  if (search->name != NULL &&
      memcmp(&one->participant_key, &search->participant, sizeof search->participant) != 0)
    return;
  if (strncmp(one->topic_name, "rt/", 3) != 0) return; /* no topic of ROS */
  demangle(one->type_name, type);
  size_t at = 0;
  while (at < into->names.size && strcmp(into->names.data[at], one->topic_name + 2) != 0) at++;
  if (at == into->names.size) {
    into->types = realloc(into->types, (at + 1) * sizeof *into->types);
    memset(&into->types[at], 0, sizeof *into->types);
    standin_add(&into->names, one->topic_name + 2);
  }
  for (size_t known = 0; known < into->types[at].size; known++)
    if (strcmp(into->types[at].data[known], type) == 0) return;
  standin_add(&into->types[at], type);
}

static int topics_of(const struct rmw_node *node, dds_entity_t endpoints, const char *name,
                     const char *space, struct names_and_types *into) {
  struct search search = {.name = name, .space = space, .into = into};
  each(((const struct node *)node->data)->participants, find_participant, &search);
  if (!search.found)
    return standin_error(RMW_NODE_NAME_NON_EXISTENT, "no node %s in %s", name, space);
  each(endpoints, add_topic, &search);
  return RMW_OK;
}

int rmw_get_publisher_names_and_types_by_node(const struct rmw_node *node,
                                              struct allocator *allocator, const char *name,
                                              const char *space, bool mangled,
                                              struct names_and_types *into) {
  (void)allocator, (void)mangled;
  return topics_of(node, ((const struct node *)node->data)->publications, name, space, into);
}

int rmw_get_subscriber_names_and_types_by_node(const struct rmw_node *node,
                                               struct allocator *allocator, const char *name,
                                               const char *space, bool mangled,
                                               struct names_and_types *into) {
  (void)allocator, (void)mangled;
  return topics_of(node, ((const struct node *)node->data)->subscriptions, name, space, into);
}

int rmw_get_topic_names_and_types(const struct rmw_node *node, struct allocator *allocator,
                                  bool mangled, struct names_and_types *into) {
  (void)allocator, (void)mangled;
  struct search search = {.into = into};
  each(((const struct node *)node->data)->publications, add_topic, &search);
  each(((const struct node *)node->data)->subscriptions, add_topic, &search);
  return RMW_OK;
}

/* How long rmw_topic_endpoint_info_t is, and where it has the GID: in Humble, or since Iron, which added a hash
 * of the type. */
#define HUMBLE 144
#define HUMBLE_GID 28
#define IRON 168
#define IRON_GID 64

struct publishers {
  const char *topic;
  struct {
    dds_guid_t participant, guid;
    char type[512];
  } *found;
  size_t count;
};

static void add_publisher(const void *sample, void *state) {
  const dds_builtintopic_endpoint_t *one = sample;
  struct publishers *all = state;
  if (strncmp(one->topic_name, "rt/", 3) != 0 || strcmp(one->topic_name + 2, all->topic) != 0)
    return;
  all->found = realloc(all->found, (all->count + 1) * sizeof *all->found);
  all->found[all->count].participant = one->participant_key;
  all->found[all->count].guid = one->key;
  demangle(one->type_name, all->found[all->count++].type);
}

struct owner {
  dds_guid_t participant;
  char name[512], space[512];
};

static void find_owner(const void *sample, void *state) {
  const dds_builtintopic_participant_t *one = sample;
  struct owner *owner = state;
  if (memcmp(&one->key, &owner->participant, sizeof one->key) != 0) return;
  if (node_of(one, owner->name, owner->space)) return;
  snprintf(owner->name, sizeof owner->name, "_CREATED_BY_BARE_DDS_APP_");
  snprintf(owner->space, sizeof owner->space, "_CREATED_BY_BARE_DDS_APP_");
}

static char *copied(const char *text, struct allocator *by) {
  char *copy = by->allocate(strlen(text) + 1, by->state);
  return strcpy(copy, text);
}

int rmw_get_publishers_info_by_topic(const struct rmw_node *node, struct allocator *allocator,
                                     const char *topic, bool mangled,
                                     struct endpoint_infos *into) {
  (void)mangled;
  struct publishers all = {.topic = topic};
  const struct node *own = node->data;
  bool humble = is_set("STANDIN_DISTRIBUTION", "humble");
  size_t length = humble ? HUMBLE : IRON, gid = humble ? HUMBLE_GID : IRON_GID;
  each(own->publications, add_publisher, &all);
  /* A middleware may take memory for itself, too. */
  void *scratch = allocator->allocate(64, allocator->state);
  scratch = allocator->reallocate(scratch, 1 << 16, allocator->state);
  allocator->deallocate(scratch, allocator->state);
  into->size = all.count;
  into->first = allocator->zero_allocate(all.count, length, allocator->state);
  for (size_t at = 0; at < all.count; at++) {
    struct owner owner = {all.found[at].participant, "_NODE_NAME_UNKNOWN_",
                          "_NODE_NAMESPACE_UNKNOWN_"};
    struct endpoint_info *one = (void *)(into->first + at * length);
    each(own->participants, find_owner, &owner);
    one->node = copied(owner.name, allocator);
    one->space = copied(owner.space, allocator);
    one->type = copied(all.found[at].type, allocator);
    memcpy((char *)one + gid, &all.found[at].guid, sizeof all.found[at].guid);
  }
  free(all.found);
  return RMW_OK;
}

int rmw_topic_endpoint_info_array_fini(struct endpoint_infos *of, struct allocator *by) {
  size_t length = is_set("STANDIN_DISTRIBUTION", "humble") ? HUMBLE : IRON;
  for (size_t at = 0; at < of->size; at++) {
    struct endpoint_info *one = (void *)(of->first + at * length);
    by->deallocate(one->node, by->state);
    by->deallocate(one->space, by->state);
    by->deallocate(one->type, by->state);
  }
  by->deallocate(of->first, by->state);
  return RMW_OK;
}
