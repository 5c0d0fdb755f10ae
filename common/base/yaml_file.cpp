// SPDX-License-Identifier: Apache-2.0
#include "common/base/yaml_file.h"

#include <fstream>
#include <sstream>

#include "common/base/plain_text.h"

namespace cairn {

Result<YAML::Node> load_yaml(const std::filesystem::path& path) {
  // Not read_text_file(): an operator may pass a pipe.
  std::ifstream file(path, std::ios::binary);
  std::ostringstream bytes;
  if (file && file.peek() != std::ifstream::traits_type::eof()) bytes << file.rdbuf();
  if (!file.is_open() || file.bad() || !bytes)
    return fail(ErrorCode::kConfiguration, path.string() + ": cannot be read");
  const auto text = plain_text(std::move(bytes).str(), path.string());
  if (!text) return fail(ErrorCode::kConfiguration, text.error().message);
  try {
    return YAML::Load(*text);
  } catch (const YAML::Exception& problem) {
    return fail(ErrorCode::kConfiguration, path.string() + ": " + problem.what());
  }
}

}  // namespace cairn
