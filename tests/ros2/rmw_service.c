/* Clients and services, as rmw_cyclonedds has them: two topics, whose messages begin with who asks
 * and the number of the question. The one service is GetState, of which a state is sent and no label. */
#define _GNU_SOURCE
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "blob.h"
#include "rmw_parts.h"

static const uint8_t little_endian[4] = {0, 1, 0, 0};

/* A message of either topic. */
struct wire {
  uint8_t encapsulation[4];
  uint8_t who[8], sequence[8]; /* as they are: what follows 4 bytes is not aligned */
  uint8_t state, padding[3];
  uint8_t label[8]; /* an empty text: its length, which counts its 0 */
};

/* One side of a service. */
struct side {
  dds_entity_t in_topic, out_topic, reader, writer;
  const void *in_type, *out_type;
  uint64_t own; /* a client's */
  int64_t next;
};

static dds_entity_t topic_of(dds_entity_t participant, const struct type_name *type,
                             const char *name, bool request, const void **made) {
  char topic[600], type_name[600];
  snprintf(topic, sizeof topic, "%s%s%s", request ? "rq" : "rr", name,
           request ? "Request" : "Reply");
  snprintf(type_name, sizeof type_name, "%s::%s::dds_::%s_%s_", type->package, type->folder,
           type->name, request ? "Request" : "Response");
  return blob_topic(participant, topic, type_name, made);
}

static struct side *open_side(const struct rmw_node *node, const struct type_support *support,
                              const char *name, bool asks) {
  static _Atomic uint32_t clients;
  dds_entity_t participant = ((const struct node *)node->data)->participant;
  struct side *made = calloc(1, sizeof *made);
  dds_qos_t *qos = dds_create_qos();
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 10);
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_INFINITY);
  made->own = (uint64_t)getpid() << 32 | clients++;
  made->out_topic = topic_of(participant, support->data, name, asks, &made->out_type);
  made->in_topic = topic_of(participant, support->data, name, !asks, &made->in_type);
  made->reader = dds_create_reader(participant, made->in_topic, qos, NULL);
  made->writer = dds_create_writer(participant, made->out_topic, qos, NULL);
  dds_delete_qos(qos);
  return made;
}

static void close_side(struct side *gone) {
  dds_delete(gone->writer);
  dds_delete(gone->reader);
  dds_delete(gone->out_topic);
  dds_delete(gone->in_topic);
  free(gone);
}

static int send_wire(const struct side *by, uint64_t who, int64_t sequence, uint8_t state,
                     size_t length) {
  struct wire message = {.state = state, .label = {1}};
  memcpy(message.encapsulation, little_endian, sizeof little_endian);
  memcpy(message.who, &who, sizeof who);
  memcpy(message.sequence, &sequence, sizeof sequence);
  dds_return_t failed = blob_write(by->writer, by->out_type, (const uint8_t *)&message, length);
  return failed < 0 ? standin_error(RMW_ERROR, "a service: %s", dds_strretcode(failed)) : RMW_OK;
}

static bool take_wire(const struct side *by, struct wire *into) {
  dds_sample_info_t info;
  const uint8_t *bytes;
  size_t length;
  struct ddsi_serdata *found = blob_take(by->reader, &info, &bytes, &length);
  if (found == NULL) return false;
  memset(into, 0, sizeof *into);
  memcpy(into, bytes, length < sizeof *into ? length : sizeof *into);
  blob_release(found);
  return true;
}

static void id_of(const struct wire *message, struct rmw_service_info *info) {
  memset(info, 0, sizeof *info);
  memcpy(info->id.writer, message->who, sizeof message->who);
  memcpy(&info->id.sequence, message->sequence, sizeof info->id.sequence);
}

struct rmw_client *rmw_create_client(const struct rmw_node *node, const struct type_support *type,
                                     const char *name, const struct rmw_qos *qos) {
  (void)qos;
  struct rmw_client *made = calloc(1, sizeof *made);
  *made = (struct rmw_client){IDENTIFIER, open_side(node, type, name, true), strdup(name)};
  return made;
}

int rmw_destroy_client(struct rmw_node *node, struct rmw_client *client) {
  (void)node;
  close_side(client->data);
  free((char *)client->name);
  free(client);
  return RMW_OK;
}

int rmw_service_server_is_available(const struct rmw_node *node, const struct rmw_client *client,
                                    bool *available) {
  (void)node;
  const struct side *of = client->data;
  dds_publication_matched_status_t out;
  dds_subscription_matched_status_t in;
  dds_get_publication_matched_status(of->writer, &out);
  dds_get_subscription_matched_status(of->reader, &in);
  *available = out.current_count > 0 && in.current_count > 0;
  return RMW_OK;
}

int rmw_send_request(const struct rmw_client *client, const void *request, int64_t *sequence) {
  (void)request;
  struct side *of = client->data;
  *sequence = ++of->next;
  return send_wire(of, of->own, *sequence, 0, offsetof(struct wire, padding));
}

int rmw_take_response(const struct rmw_client *client, struct rmw_service_info *info,
                      void *response, bool *taken) {
  const struct side *of = client->data;
  struct wire message;
  *taken = false;
  while (!*taken && take_wire(of, &message)) {
    uint64_t who;
    memcpy(&who, message.who, sizeof who);
    *taken = who == of->own; /* others get answers on the topic, too */
  }
  if (!*taken) return RMW_OK;
  id_of(&message, info);
  ((struct get_state_response *)response)->id = message.state;
  return RMW_OK;
}

struct rmw_service *rmw_create_service(const struct rmw_node *node,
                                       const struct type_support *type, const char *name,
                                       const struct rmw_qos *qos) {
  (void)qos;
  struct rmw_service *made = calloc(1, sizeof *made);
  *made = (struct rmw_service){IDENTIFIER, open_side(node, type, name, false), strdup(name)};
  return made;
}

int rmw_destroy_service(struct rmw_node *node, struct rmw_service *service) {
  (void)node;
  close_side(service->data);
  free((char *)service->name);
  free(service);
  return RMW_OK;
}

int rmw_take_request(const struct rmw_service *service, struct rmw_service_info *info,
                     void *request, bool *taken) {
  (void)request;
  struct wire message;
  *taken = take_wire(service->data, &message);
  if (*taken) id_of(&message, info);
  return RMW_OK;
}

int rmw_send_response(const struct rmw_service *service, struct rmw_request_id *id,
                      void *response) {
  uint64_t who;
  memcpy(&who, id->writer, sizeof who);
  uint8_t state = ((const struct get_state_response *)response)->id;
  return send_wire(service->data, who, id->sequence, state, sizeof(struct wire));
}
