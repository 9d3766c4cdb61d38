/* Where the stand-in's programs look for each other: unicast on loopback, for more processes than
 * Cyclone looks for. CYCLONEDDS_URI is put on top of it, unless it names interfaces of its own. */
#pragma once
#include <dds/dds.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static inline dds_entity_t loopback_domain(dds_domainid_t number) {
  static const char loopback[] =
      "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name=\"lo\" multicast=\"false\"/>"
      "</Interfaces><AllowMulticast>false</AllowMulticast></General><Discovery>"
      "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>40</MaxAutoParticipantIndex>"
      "<Peers><Peer address=\"127.0.0.1\"/></Peers></Discovery></Domain></CycloneDDS>";
  const char *own = getenv("CYCLONEDDS_URI");
  if (own == NULL || own[0] == 0) return dds_create_domain(number, loopback);
  if (strstr(own, "<Interfaces>") != NULL) return dds_create_domain(number, own);
  char both[4096];
  snprintf(both, sizeof both, "%s,%s", loopback, own);
  return dds_create_domain(number, both);
}
