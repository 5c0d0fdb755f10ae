// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>

#include "server/endpoint/server_options.h"

namespace cairn {

/// A long option of cairn-server that takes a value, which may also stand in the configuration file.
struct ServerOptionRow {
  const char* name;
  const char* type;
  const char* help;
  /// Description of valid values, for the complaint.
  const char* expected;
  /// Reads a value. False: the text is no such value, and `options` is as it was. Null: not available yet.
  bool (*read)(const std::string& text, ServerOptions* options);
  /// The value as text that read() takes; empty: none.
  std::string (*write)(const ServerOptions& options);
  /// Whether the value depends on another option or on the machine if it is not given.
  bool depends = false;
  /// Older name, which still works on the line and in files. Null: none.
  const char* older_name = nullptr;
};

/// All such options, in the order of --help.
[[nodiscard]] std::span<const ServerOptionRow> server_option_rows();

}  // namespace cairn
