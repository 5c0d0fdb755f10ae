// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <spdlog/logger.h>

#include <memory>
#include <string>
#include <string_view>

namespace cairn {

using Logger = std::shared_ptr<spdlog::logger>;

/// A logger that talks to stderr (data go to stdout), colour only on a terminal and never with NO_COLOR.
/// `verbosity`: -1 quiet (warnings), 0 info, 1 debug. Thread-safe. Each message is one line that no terminal
/// takes amiss, whatever bytes are in it (one_line in utf8.h). It never waits for the reader of a pipe or
/// terminal: lines without room are left out and counted in the next one that has room; the last owner waits
/// at most 1 s for a reader that takes nothing.
[[nodiscard]] Logger make_logger(const std::string& process_name, int verbosity = 0, int descriptor = 2);

/// "PROGRAM: MESSAGE" on stderr, where there is no logger yet; of the message, whatever is in it, one line.
void say_error(std::string_view program, std::string_view message);

/// Says nothing; the default for engines and tests.
[[nodiscard]] Logger null_logger();

}  // namespace cairn
