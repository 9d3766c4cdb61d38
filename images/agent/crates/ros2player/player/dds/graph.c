/* The nodes of the graph, as far as DDS says who is there: by what participants of ROS 2 announce of their
 * nodes, by names in their user data, or, of others that use ROS 2's topics, without a name. */
#define _GNU_SOURCE
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "participant.h"
#include "nodes.h"

#define MOST_ENTITIES (1u << 16) /* of each kind */
#define MOST_UNNAMED 4096
#define UNREADABLE "the graph can't be read, or has 65536 endpoints"

/* What a reader knows to be there, lent until it is given back. */
struct lent {
  dds_entity_t reader;
  void **samples;
  dds_sample_info_t *infos;
  size_t count;
};

static dds_entity_t participants, publications, subscriptions;

bool graph_prepare(struct answer *into) {
  participants = dds_create_reader(participant, DDS_BUILTIN_TOPIC_DCPSPARTICIPANT, NULL, NULL);
  publications = dds_create_reader(participant, DDS_BUILTIN_TOPIC_DCPSPUBLICATION, NULL, NULL);
  subscriptions = dds_create_reader(participant, DDS_BUILTIN_TOPIC_DCPSSUBSCRIPTION, NULL, NULL);
  if (participants < 0) return answer_dds(into, "dds_create_reader", participants);
  if (publications < 0) return answer_dds(into, "dds_create_reader", publications);
  return subscriptions >= 0 || answer_dds(into, "dds_create_reader", subscriptions);
}

static void give_back(struct lent *lent) {
  if (lent->count > 0) (void)!dds_return_loan(lent->reader, lent->samples, (int32_t)lent->count);
  free(lent->samples);
  free(lent->infos);
}

/* All that is there; what is gone is left out. False if there is no memory for it. */
static bool borrow(dds_entity_t reader, struct lent *lent) {
  for (size_t room = 256; room <= MOST_ENTITIES; room *= 4) {
    *lent = (struct lent){reader, calloc(room, sizeof(void *)), NULL, 0};
    lent->infos = calloc(room, sizeof *lent->infos);
    if (lent->samples == NULL || lent->infos == NULL) break;
    dds_return_t some = dds_read_mask(reader, lent->samples, lent->infos, room, (uint32_t)room,
                                      DDS_ANY_SAMPLE_STATE | DDS_ANY_VIEW_STATE |
                                          DDS_ALIVE_INSTANCE_STATE);
    lent->count = some > 0 ? (size_t)some : 0;
    if (lent->count < room || room == MOST_ENTITIES) return some >= 0 && lent->count < room;
    give_back(lent);
  }
  return false;
}

struct graph {
  struct lent participants, publications, subscriptions;
  struct answer *into;
  uint32_t nodes;
};

/* Package, folder and name of the type `package::folder::dds_::Name_`, with slashes; false if it is
 * no type of ROS. */
static bool demangle(const char *type, char into[800]) {
  char package[256], folder[256], name[256];
  int end = 0;
  if (sscanf(type, "%255[^:]::%255[^:]::dds_::%255[^:]%n", package, folder, name, &end) != 3)
    return false;
  size_t length = strlen(name);
  if (type[end] != 0 || length < 2 || name[length - 1] != '_') return false;
  name[length - 1] = 0;
  snprintf(into, 800, "%s/%s/%s", package, folder, name);
  return true;
}

/* Which endpoints are a node's: those of a participant, or those in a list. */
struct owner {
  const dds_guid_t *participant;
  const struct guids *listed;
};

static const dds_builtintopic_endpoint_t *owned(const struct lent *of, size_t at,
                                                const struct owner *owner) {
  const dds_builtintopic_endpoint_t *one = of->samples[at];
  if (!of->infos[at].valid_data || strncmp(one->topic_name, "rt/", 3) != 0) return NULL;
  if (memcmp(&one->participant_key, owner->participant, sizeof one->participant_key) != 0)
    return NULL;
  return owner->listed == NULL || guids_have(owner->listed, &one->key) ? one : NULL;
}

/* u32: how many; of each: its topic, its first type. */
static uint32_t topics(struct answer *into, const struct lent *of, const struct owner *owner) {
  uint32_t count = 0;
  size_t place = into->length;
  answer_number(into, 0);
  for (size_t at = 0; at < of->count; at++) {
    const dds_builtintopic_endpoint_t *one = owned(of, at, owner);
    char type[800];
    if (one == NULL || !demangle(one->type_name, type)) continue;
    bool known = false;
    for (size_t before = 0; before < at && !known; before++) {
      const dds_builtintopic_endpoint_t *other = owned(of, before, owner);
      known = other != NULL && strcmp(other->topic_name, one->topic_name) == 0;
    }
    if (known) continue;
    answer_text(into, one->topic_name + 2);
    answer_text(into, type);
    count++;
  }
  memcpy(into->bytes + place, &count, sizeof count);
  return count;
}

static uint32_t add(struct graph *graph, const char *space, const char *name,
                    const struct owner *writers, const struct owner *readers) {
  answer_text(graph->into, space);
  answer_text(graph->into, name);
  graph->nodes++;
  uint32_t some = topics(graph->into, &graph->publications, writers);
  return some + topics(graph->into, &graph->subscriptions, readers);
}

struct announcing {
  struct graph *graph;
  const dds_guid_t *participant;
};

static void add_announced(const struct announced_node *node, void *state) {
  const struct announcing *announcing = state;
  struct owner writers = {announcing->participant, &node->writers};
  struct owner readers = {announcing->participant, &node->readers};
  add(announcing->graph, node->space, node->name, &writers, &readers);
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

static void user_data(const dds_builtintopic_participant_t *one, char into[1024]) {
  void *data = NULL;
  size_t length = 0;
  into[0] = 0;
  if (!dds_qget_userdata(one->qos, &data, &length) || data == NULL) return;
  snprintf(into, 1024, "%.*s", length < 1024 ? (int)length : 1023, (const char *)data);
  dds_free(data);
}

/* Its number among those that have no name, which it keeps. */
static size_t number_of(const dds_guid_t *one) {
  static dds_guid_t unnamed[MOST_UNNAMED];
  static size_t count;
  for (size_t at = 0; at < count; at++)
    if (memcmp(&unnamed[at], one, sizeof *one) == 0) return at + 1;
  if (count == MOST_UNNAMED) return count + 1;
  unnamed[count++] = *one;
  return count;
}

/* Whether something of a participant is published or subscribed to on a topic of ROS 2. */
static bool takes_part(const struct graph *graph, const dds_guid_t *one) {
  struct owner owner = {one, NULL};
  const struct lent *both[] = {&graph->publications, &graph->subscriptions};
  for (size_t side = 0; side < 2; side++)
    for (size_t at = 0; at < both[side]->count; at++)
      if (owned(both[side], at, &owner) != NULL) return true;
  return false;
}

static void add_participant(struct graph *graph, const dds_builtintopic_participant_t *one) {
  char data[1024], name[512], space[512];
  struct owner whole = {&one->key, NULL};
  struct announcing announcing = {graph, &one->key};
  user_data(one, data);
  if (part_of(data, "name=", name) && part_of(data, "namespace=", space)) {
    add(graph, space, name, &whole, &whole);
    return;
  }
  /* Of ROS 2's, what no node has is not reported, as rcl does not: it will be a node's. */
  if (nodes_of(&one->key, add_announced, &announcing) || strstr(data, "enclave=") != NULL) return;
  if (!takes_part(graph, &one->key)) return;
  snprintf(name, sizeof name, "unnamed_dds_participant_%zu", number_of(&one->key));
  add(graph, "/", name, &whole, &whole);
}

static bool is_there(const dds_guid_t *wanted, void *state) {
  const struct lent *all = state;
  for (size_t at = 0; at < all->count; at++) {
    const dds_builtintopic_participant_t *one = all->samples[at];
    if (memcmp(&one->key, wanted, sizeof *wanted) == 0) return true;
  }
  return false;
}

void middleware_graph(struct answer *into) {
  struct graph graph = {.into = into};
  bool all = borrow(participants, &graph.participants);
  all = borrow(publications, &graph.publications) && all;
  all = borrow(subscriptions, &graph.subscriptions) && all;
  answer_number(into, STATUS_DONE);
  size_t place = into->length;
  answer_number(into, 0);
  nodes_refresh();
  for (size_t at = 0; at < graph.participants.count; at++)
    if (graph.participants.infos[at].valid_data)
      add_participant(&graph, graph.participants.samples[at]);
  memcpy(into->bytes + place, &graph.nodes, sizeof graph.nodes);
  if (all) nodes_forget(is_there, &graph.participants);
  else answer_failed(into, STATUS_REQUEST, UNREADABLE);
  give_back(&graph.participants);
  give_back(&graph.publications);
  give_back(&graph.subscriptions);
}

static bool is_on(const struct lent *of, size_t at, const char *topic) {
  const dds_builtintopic_endpoint_t *one = of->samples[at];
  return of->infos[at].valid_data && strncmp(one->topic_name, "rt/", 3) == 0 &&
         strcmp(one->topic_name + 2, topic) == 0;
}

static int by_topic_and_type(const void *left, const void *right) {
  const dds_builtintopic_endpoint_t *one = *(void *const *)left, *other = *(void *const *)right;
  int order = strcmp(one->topic_name, other->topic_name);
  return order != 0 ? order : strcmp(one->type_name, other->type_name);
}

/* In their order: each topic once, with how many types it has and the first of them. */
static uint32_t add_topics(void **sorted, size_t count, struct answer *into) {
  uint32_t topics = 0;
  for (size_t first = 0; first < count; topics++) {
    const dds_builtintopic_endpoint_t *one = sorted[first], *last = one;
    uint32_t types = 1;
    char type[800];
    for (; first < count; first++) {
      const dds_builtintopic_endpoint_t *other = sorted[first];
      if (strcmp(one->topic_name, other->topic_name) != 0) break;
      if (strcmp(last->type_name, other->type_name) != 0) types++;
      last = other;
    }
    answer_text(into, one->topic_name + 2);
    answer_number(into, types);
    answer_text(into, demangle(one->type_name, type) ? type : one->type_name);
  }
  return topics;
}

void middleware_topics(struct answer *into) {
  struct lent lent;
  bool all = borrow(publications, &lent);
  void **sorted = calloc(lent.count + 1, sizeof *sorted);
  if (!all || sorted == NULL) {
    answer_failed(into, STATUS_REQUEST, UNREADABLE);
  } else {
    size_t count = 0;
    for (size_t at = 0; at < lent.count; at++) {
      const dds_builtintopic_endpoint_t *one = lent.samples[at];
      if (lent.infos[at].valid_data && strncmp(one->topic_name, "rt/", 3) == 0)
        sorted[count++] = lent.samples[at];
    }
    qsort(sorted, count, sizeof *sorted, by_topic_and_type);
    answer_number(into, STATUS_DONE);
    size_t place = into->length;
    answer_number(into, 0);
    uint32_t topics = add_topics(sorted, count, into);
    memcpy(into->bytes + place, &topics, sizeof topics);
  }
  free(sorted);
  give_back(&lent);
}

/* Whose an endpoint is: both empty as long as that is not known. */
struct whose {
  const dds_guid_t *endpoint;
  char space[512], name[512];
};

static void find_endpoint(const struct announced_node *node, void *state) {
  struct whose *whose = state;
  if (!guids_have(&node->writers, whose->endpoint)) return;
  snprintf(whose->space, sizeof whose->space, "%s", node->space);
  snprintf(whose->name, sizeof whose->name, "%s", node->name);
}

/* As `add_participant` calls it. */
static void find_node(const struct lent *all, const dds_guid_t *participant, struct whose *whose) {
  char data[1024] = "";
  for (size_t at = 0; at < all->count && data[0] == 0; at++) {
    const dds_builtintopic_participant_t *one = all->samples[at];
    if (all->infos[at].valid_data && memcmp(&one->key, participant, sizeof one->key) == 0)
      user_data(one, data);
  }
  if (part_of(data, "name=", whose->name) && part_of(data, "namespace=", whose->space)) return;
  whose->name[0] = whose->space[0] = 0;
  if (nodes_of(participant, find_endpoint, whose) || strstr(data, "enclave=") != NULL) return;
  snprintf(whose->space, sizeof whose->space, "/");
  snprintf(whose->name, sizeof whose->name, "unnamed_dds_participant_%zu", number_of(participant));
}

static uint32_t add_publishers(const struct lent *publishers, const struct lent *owners,
                               const char *topic, struct answer *into) {
  uint32_t count = 0;
  for (size_t at = 0; at < publishers->count; at++) {
    const dds_builtintopic_endpoint_t *one = publishers->samples[at];
    char type[800];
    if (!is_on(publishers, at, topic)) continue;
    struct whose whose = {.endpoint = &one->key};
    find_node(owners, &one->participant_key, &whose);
    answer_text(into, whose.space);
    answer_text(into, whose.name);
    answer_text(into, demangle(one->type_name, type) ? type : one->type_name);
    answer_gid(into, one->key.v);
    count++;
  }
  return count;
}

void middleware_topic(const char *topic, struct answer *into) {
  struct lent owners, publishers;
  /* In this order: whose an endpoint is is known before it is. */
  bool all = borrow(publications, &publishers);
  all = borrow(participants, &owners) && all;
  nodes_refresh();
  answer_number(into, STATUS_DONE);
  size_t place = into->length;
  answer_number(into, 0);
  uint32_t count = add_publishers(&publishers, &owners, topic, into);
  memcpy(into->bytes + place, &count, sizeof count);
  if (!all) answer_failed(into, STATUS_REQUEST, UNREADABLE);
  give_back(&owners);
  give_back(&publishers);
}
