// SPDX-License-Identifier: Apache-2.0
#include "common/base/result.h"

namespace cairn {

int exit_code(ErrorCode code) {
  switch (code) {
    case ErrorCode::kUsage:
      return 2;
    case ErrorCode::kConfiguration:
    case ErrorCode::kNotFound:
    case ErrorCode::kIo:
      return 3;
    case ErrorCode::kNoServer:
      return 4;
    case ErrorCode::kRefused:
      return 5;
    case ErrorCode::kDamaged:
      return 6;
    case ErrorCode::kDegenerate:
    case ErrorCode::kInternal:
      return 1;
  }
  return 1;
}

}  // namespace cairn
