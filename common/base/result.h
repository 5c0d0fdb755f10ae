// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <utility>

namespace cairn {

/// The kind of thing that went wrong; each maps to one exit code of the command line (exit_code()).
enum class ErrorCode {
  kUsage,          ///< the caller's words are off
  kConfiguration,  ///< a file of settings or a calibration is missing or wrong
  kNoServer,       ///< nobody answers at the other end
  kRefused,        ///< the other end said no
  kDamaged,        ///< data exist and cannot be read
  kNotFound,       ///< a named thing does not exist
  kIo,             ///< the operating system said no
  kDegenerate,     ///< the numbers do not determine an answer (geometry)
  kInternal,       ///< a broken invariant of ours
};

/// An error that names the thing and, where there is one, the remedy: "camera.txt: no such file; pass
/// --calibration".
struct [[nodiscard]] Error {
  ErrorCode code = ErrorCode::kInternal;
  std::string message;
};

/// The value or the reason why not, for everything the outside can cause. Exceptions are for programming
/// errors only.
template <typename T>
using Result = tl::expected<T, Error>;

/// Success without a value: `Result<void>`; `return {};`.
using Status = Result<void>;

/// Shorthand for `return fail(ErrorCode::kIo, "...")`.
[[nodiscard]] inline tl::unexpected<Error> fail(ErrorCode code, std::string message) {
  return tl::unexpected<Error>(Error{code, std::move(message)});
}

/// Process exit code of the command-line contract for an error.
/// 1 failed check, 2 usage, 3 configuration, 4 no server, 5 refused, 6 damaged data.
[[nodiscard]] int exit_code(ErrorCode code);

}  // namespace cairn
