// SPDX-License-Identifier: Apache-2.0
#include "common/wire/internal/sertype.h"

#include <arpa/inet.h>
#include <dds/ddsi/ddsi_domaingv.h>
#include <dds/ddsi/ddsi_entity.h>
#include <dds/ddsi/q_hbcontrol.h>
// These need what the two above declare.
#include <dds/ddsi/ddsi_endpoint.h>
#include <dds/ddsi/ddsi_entity_index.h>
#include <dds/ddsi/ddsi_serdata.h>
#include <dds/ddsi/q_thread.h>
#include <string.h>

/// What the middleware knows of the participant's domain: every type names it, also that of the built-in
/// topic in which each participant finds itself.
static const struct ddsi_domaingv* domain_of(dds_entity_t participant) {
  const dds_entity_t reader = dds_create_reader(participant, DDS_BUILTIN_TOPIC_DCPSPARTICIPANT, NULL, NULL);
  if (reader < 0) return NULL;
  const struct ddsi_domaingv* domain = NULL;
  struct ddsi_serdata* found = NULL;
  dds_sample_info_t info;
  if (dds_takecdr(reader, &found, 1, &info, DDS_ANY_STATE) == 1) {
    domain = ddsrt_atomic_ldvoidp(&found->type->gv);
    ddsi_serdata_unref(found);
  }
  (void)dds_delete(reader);
  return domain;
}

/// The id under which the middleware has an entity in its index, in the byte order of this machine.
static bool id_of(dds_entity_t entity, struct ddsi_guid* id) {
  dds_guid_t sent;
  if (dds_get_guid(entity, &sent) != DDS_RETCODE_OK) return false;
  memcpy(id, &sent, sizeof(*id));
  for (int i = 0; i < 3; ++i) id->prefix.u[i] = ntohl(id->prefix.u[i]);
  id->entityid.u = ntohl(id->entityid.u);
  return true;
}

const struct ddsi_sertype* cairn_wire_sertype(dds_entity_t participant, dds_entity_t writer) {
  struct ddsi_guid id;
  const struct ddsi_domaingv* domain = domain_of(participant);
  if (domain == NULL || !id_of(writer, &id)) return NULL;
  struct thread_state* const thread = lookup_thread_state();
  thread_state_awake(thread, domain);  // what is found stays until it sleeps again
  const struct ddsi_writer* found = entidx_lookup_writer_guid(domain->entity_index, &id);
  const struct ddsi_sertype* type = found != NULL ? found->type : NULL;
  if (type != NULL && type->base_sertype != NULL) type = NULL;  // would go with the writer
  thread_state_asleep(thread);
  return type;
}
