// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "common/base/result.h"

namespace cairn {

/// Whose camera each client is, by the clients' names.
using WearerList = std::map<std::string, std::string>;

/// Who wears which cameras, as the operator has written it down: YAML with a wearer's name as key and the
/// names of the clients as a list, `anna: [hand-1, shoulder-1]`. Errors: kConfiguration, with the line.
[[nodiscard]] Result<WearerList> read_wearers(const std::filesystem::path& path);

}  // namespace cairn
