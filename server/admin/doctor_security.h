// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "common/base/time.h"
#include "server/admin/doctor.h"

/// Checks of the keys of a secured site, before what is wrong with them keeps somebody out.
namespace cairn {

/// `expires`: of the certificate that goes first, called `name`: role and name.
[[nodiscard]] Finding judge_certificate(const std::string& name, Timestamp expires, Timestamp now);

/// Looks at a security folder, as --security takes it: whether it is whole, when its certificate and its
/// authorities expire, and the list of those who are revoked. If it is not whole, that alone is told.
[[nodiscard]] std::vector<Finding> look_at_security(const std::string& folder, Timestamp now);

/// What is told of the server where it cannot be asked, since it answers only operators: the keys in this
/// folder are others', or of no use. Nothing: it can be asked.
[[nodiscard]] std::optional<Finding> why_not_asked(const std::string& folder, Timestamp now);

/// Looks at the certificates of a folder with a register: that of a site's keys, or a server's security
/// folder.
[[nodiscard]] Finding look_at_certificates(const std::string& folder, Timestamp now);

}  // namespace cairn
