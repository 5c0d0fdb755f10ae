// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "server/service/service_output.h"

namespace cairn {

/// The event with its reasons as who receives them takes them: one line of text that is not too long. They
/// name what others have written, or a library has said, and a verdict must arrive all the same. Pure.
[[nodiscard]] ClientEvent with_fitting_words(ClientEvent event);

}  // namespace cairn
