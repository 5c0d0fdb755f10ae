// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "common/wire/messages.h"
#include "server/service/operator_answer.h"

namespace cairn {

/// What an operator is answered, for the wire: JSON (idl/README.md, AdminReply), of long lists as much as one
/// reply takes. Pure.
[[nodiscard]] wire::AdminReply reply_of(const OperatorAnswer& answer);

}  // namespace cairn
