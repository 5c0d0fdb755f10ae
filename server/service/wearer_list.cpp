// SPDX-License-Identifier: Apache-2.0
#include "server/service/wearer_list.h"

#include <string>

#include "common/base/yaml_file.h"
#include "common/map/ids.h"

namespace cairn {
namespace {

tl::unexpected<Error> wrong(const std::filesystem::path& path, const YAML::Node& at, const std::string& why) {
  return fail(ErrorCode::kConfiguration,
              path.string() + ":" + std::to_string(at.Mark().line + 1) + ": " + why);
}

}  // namespace

Result<WearerList> read_wearers(const std::filesystem::path& path) {
  const auto loaded = load_yaml(path);
  if (!loaded) return tl::unexpected(loaded.error());
  const YAML::Node& root = *loaded;
  WearerList list;
  if (root.IsNull()) return list;
  if (!root.IsMap()) return wrong(path, root, "expected `anna: [hand-1, shoulder-1]`");
  for (const auto& entry : root) {
    if (!entry.first.IsScalar() || !entry.second.IsSequence())
      return wrong(path, entry.first, "expected `anna: [hand-1, shoulder-1]`");
    const std::string wearer = entry.first.Scalar();
    if (!is_valid_name(wearer))
      return wrong(path, entry.first, "name '" + wearer + "': expected 1 to 32 of a-z, 0-9 and -");
    for (const YAML::Node& client : entry.second) {
      if (!client.IsScalar() || !is_valid_name(client.Scalar()))
        return wrong(path, client, "the name of a client: expected 1 to 32 of a-z, 0-9 and -");
      if (!list.emplace(client.Scalar(), wearer).second)
        return wrong(path, client,
                     "'" + client.Scalar() + "' is worn by " + list[client.Scalar()] + " already");
    }
  }
  return list;
}

}  // namespace cairn
