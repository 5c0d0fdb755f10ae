// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <dds/dds.h>

#ifdef __cplusplus
extern "C" {
#endif

/// The type by which the middleware serializes what a writer of that participant writes: that of its topic,
/// as whose part it lives. Null: the writer is no more, or has a type of its own. Cyclone DDS 0.10 has no
/// call for it, so this reads the middleware's own records, whose headers it installs; they are C only.
/// Thread-safe.
const struct ddsi_sertype* cairn_wire_sertype(dds_entity_t participant, dds_entity_t writer);

#ifdef __cplusplus
}
#endif
