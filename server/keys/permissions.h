// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "server/keys/authority.h"
#include "server/keys/identity.h"

/// The documents of DDS Security, as XML texts to be signed. Pure.
namespace cairn {

/// What holds for the whole site: nobody joins without a certificate, all content and discovery is encrypted,
/// the messages of the protocol are signed, each topic asks for permission to write and to read.
[[nodiscard]] std::string make_governance();

/// What one identity may write and read, and in which partitions (common/wire/partition.h): its own. All else
/// is denied. `subject`: of its certificate (subject_of()).
[[nodiscard]] std::string make_permissions(const Identity& identity, const std::string& subject,
                                           const Validity& validity);

}  // namespace cairn
