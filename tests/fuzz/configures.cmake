# SPDX-License-Identifier: Apache-2.0
# cmake -D FOLDER=... -P configures.cmake, in the source folder: configures the preset fuzz into FOLDER, from nothing.
find_program(CLANG clang++)
if(NOT CLANG)
  message("clang++ is missing; deploy/install-packages fuzz installs it")
  return()
endif()
# Flags of other compilers are not Clang's.
execute_process(COMMAND ${CMAKE_COMMAND} -E env --unset=CXXFLAGS --unset=CFLAGS ${CMAKE_COMMAND} --fresh --preset fuzz -B ${FOLDER}
  COMMAND_ERROR_IS_FATAL ANY)
