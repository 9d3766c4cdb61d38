/* Joins a domain as a participant, on loopback alone, and leaves it. */
#define _GNU_SOURCE
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>

#include "participant.h"
#include "sending.h"

/* Whom it looks for: nodes that ROS 2 keeps on this machine listen at one of these ports of each
 * domain, and some (Humble's over Cyclone DDS) for multicast alone. */
static const char settings[] =
    "<CycloneDDS><Domain><General><Interfaces>"
    "<NetworkInterface address=\"127.0.0.1\" multicast=\"true\"/></Interfaces>"
    "<AllowMulticast>spdp</AllowMulticast><MaxMessageSize>65500B</MaxMessageSize></General>"
    "<Discovery>"
    "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>40</MaxAutoParticipantIndex>"
    "<Peers><Peer address=\"127.0.0.1\"/></Peers></Discovery></Domain></CycloneDDS>";

#define MOST_DOMAIN 232 /* of which there are ports */

dds_entity_t participant;
static dds_entity_t own_domain;

bool answer_dds(struct answer *into, const char *function, dds_return_t failed) {
  answer_call(into, function, failed, dds_strretcode(failed));
  return false;
}

/* The number in ROS_DOMAIN_ID; -1 if it is none. */
static int domain_number(void) {
  const char *text = getenv("ROS_DOMAIN_ID");
  if (text == NULL || text[0] == 0) return 0;
  char *end;
  unsigned long number = strtoul(text, &end, 10);
  return *end == 0 && number <= MOST_DOMAIN ? (int)number : -1;
}

/* The domain with the image's own settings on top, as rmw_cyclonedds has them; negative if it is not
 * to be had. */
static dds_entity_t make_domain(int number) {
  const char *own = getenv("CYCLONEDDS_URI");
  char *both = NULL;
  if (own == NULL || own[0] == 0) own = NULL;
  if (own != NULL && asprintf(&both, "%s,%s", settings, own) < 0) return DDS_RETCODE_OUT_OF_RESOURCES;
  dds_entity_t made = dds_create_domain((dds_domainid_t)number, own == NULL ? settings : both);
  free(both);
  return made;
}

bool middleware_join(const char *name, const char *space, struct answer *into) {
  atomic_store(&holds_back, true);
  int domain = domain_number();
  if (domain < 0) {
    answer_failed(into, STATUS_REQUEST, "ROS_DOMAIN_ID is no number from 0 to 232");
    return false;
  }
  own_domain = make_domain(domain);
  if (own_domain < 0)
    return answer_dds(into, "dds_create_domain (with CYCLONEDDS_URI)", own_domain);
  /* As nodes of ROS 2 announced their names before Foxy: it needs no type that changed since. */
  char text[1024];
  int length = snprintf(text, sizeof text, "name=%.400s;namespace=%.400s;", name, space);
  dds_qos_t *qos = dds_create_qos();
  dds_qset_userdata(qos, text, (size_t)length);
  participant = dds_create_participant((dds_domainid_t)domain, qos, NULL);
  dds_delete_qos(qos);
  if (participant < 0) return answer_dds(into, "dds_create_participant", participant);
  return graph_prepare(into) && nodes_prepare(into) && wait_prepare(into);
}

/* What a service's messages begin with differs between RMWs. */
void node_state(uint32_t number, const char *name, struct answer *into) {
  (void)number, (void)name;
  answer_failed(into, STATUS_REQUEST, "on DDS alone no service is called");
}

/* With all that is in it. A participant alone is deleted by another thread: the program might end before, and
 * all others had it in their graphs for its lease, of ten seconds. */
void middleware_leave(void) {
  if (own_domain > 0) dds_delete(own_domain);
}
