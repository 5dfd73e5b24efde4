// Steps a plant and a firmware of FMI 2.0 in the order of a tick and prints the codes of each step:
//   unit_loop PLANT FIRMWARE STEPS TICKS_OF_A_STEP, where PLANT and FIRMWARE are files with the
//   lines: library, folder of the resources as URI, token, and the value references of NAMES.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifdef _WIN32
#include <windows.h>
#define OPEN(file) (void *)LoadLibraryA(file)
#define FIND(library, name) (void *)GetProcAddress((HMODULE)(library), name)
#else
#include <dlfcn.h>
#define OPEN(file) dlopen(file, RTLD_NOW)
#define FIND(library, name) dlsym(library, name)
#endif
#include <fmi2FunctionTypes.h>

enum { ENCODER, ADC0, ADC1, DAC, ENABLE, RELEASE, NAMES };

typedef struct {
  fmi2Component unit;
  fmi2ValueReference of[NAMES];
  fmi2GetIntegerTYPE *get;
  fmi2SetIntegerTYPE *set;
  fmi2GetBooleanTYPE *get_bool;
  fmi2SetBooleanTYPE *set_bool;
  fmi2DoStepTYPE *step;
} unit_t;

static void check(int is_right, const char *what) {
  if (is_right) return;
  fprintf(stderr, "unit_loop: %s\n", what);
  exit(1);
}

static void say(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status,
                fmi2String category, fmi2String text, ...) {
  (void)environment, (void)category;
  fprintf(stderr, "%s: %d: %s\n", name, status, text);
}

static const fmi2CallbackFunctions callbacks = {say, calloc, free, NULL, NULL};

static unit_t opened(const char *file) {
  char line[3][4096];
  unit_t unit;
  FILE *stream = fopen(file, "r");
  check(stream != NULL, file);
  for (int i = 0; i < 3; ++i) {
    check(fgets(line[i], sizeof line[i], stream) != NULL, "expected three lines");
    line[i][strcspn(line[i], "\r\n")] = 0;
  }
  for (int i = 0; i < NAMES; ++i) check(fscanf(stream, "%u", &unit.of[i]) == 1, "expected numbers");
  fclose(stream);
  void *library = OPEN(line[0]);
  check(library != NULL, line[0]);
  fmi2InstantiateTYPE *create = (fmi2InstantiateTYPE *)FIND(library, "fmi2Instantiate");
  fmi2SetupExperimentTYPE *setup = (fmi2SetupExperimentTYPE *)FIND(library, "fmi2SetupExperiment");
  fmi2EnterInitializationModeTYPE *enter =
      (fmi2EnterInitializationModeTYPE *)FIND(library, "fmi2EnterInitializationMode");
  fmi2ExitInitializationModeTYPE *leave =
      (fmi2ExitInitializationModeTYPE *)FIND(library, "fmi2ExitInitializationMode");
  unit.get = (fmi2GetIntegerTYPE *)FIND(library, "fmi2GetInteger");
  unit.set = (fmi2SetIntegerTYPE *)FIND(library, "fmi2SetInteger");
  unit.get_bool = (fmi2GetBooleanTYPE *)FIND(library, "fmi2GetBoolean");
  unit.set_bool = (fmi2SetBooleanTYPE *)FIND(library, "fmi2SetBoolean");
  unit.step = (fmi2DoStepTYPE *)FIND(library, "fmi2DoStep");
  unit.unit = create("unit", fmi2CoSimulation, line[2], line[1], &callbacks, fmi2False, fmi2False);
  check(unit.unit != NULL, "expected an instance");
  check(setup(unit.unit, fmi2False, 0, 0, fmi2False, 0) == fmi2OK, "setup");
  check(enter(unit.unit) == fmi2OK && leave(unit.unit) == fmi2OK, "initialization");
  return unit;
}

int main(int count, char **words) {
  check(count == 5, "expected PLANT FIRMWARE STEPS TICKS_OF_A_STEP");
  unit_t plant = opened(words[1]), firmware = opened(words[2]);
  const long steps = atol(words[3]);
  const double step_s = atof(words[4]) / 1500;
  for (long k = 0; k < steps; ++k) {
    fmi2Integer codes[3], dac;
    fmi2Boolean outputs[2];
    int bad = plant.get(plant.unit, plant.of, 3, codes);
    bad |= firmware.set(firmware.unit, firmware.of, 3, codes);
    bad |= firmware.step(firmware.unit, (double)k * step_s, step_s, fmi2True);
    bad |= firmware.get(firmware.unit, &firmware.of[DAC], 1, &dac);
    bad |= firmware.get_bool(firmware.unit, &firmware.of[ENABLE], 2, outputs);
    bad |= plant.set(plant.unit, &plant.of[DAC], 1, &dac);
    bad |= plant.set_bool(plant.unit, &plant.of[ENABLE], 2, outputs);
    bad |= plant.step(plant.unit, (double)k * step_s, step_s, fmi2True);
    check(bad == 0, "expected fmi2OK of each call");
    printf("%d %d %d %d %d\n", codes[0], codes[1], codes[2], dac, outputs[0]);
  }
  return 0;
}
