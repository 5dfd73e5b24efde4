"""Twelve axes as their data sheets would have them, options of `forceaxis new` by what they are."""

AXES = {
    "press, ball screw, stiff workpiece, 12 bits": "--moving-mass-kg 50 --lead-mm-per-rev 25 "
    "--rotor-inertia-kg-m2 0.0013 --torque-constant-n-m-per-a 0.5 --resistance-ohm 4.5 "
    "--inductance-h 0.0158 --motor-peak-current-a 30 --supply-v 60 --full-scale-speed-m-per-s 0.4 "
    "--sensor-full-scale-n 300 --sensor-stiffness-n-per-m 4e5 --workpiece-stiffness-n-per-m 4e5 "
    "--workpiece-mass-kg 6 --workpiece-damping-ratio 0.005",
    "laboratory robot, 8 bits": "--moving-mass-kg 52.9 --lead-mm-per-rev 25.4 "
    "--rotor-inertia-kg-m2 0.0013 --torque-constant-n-m-per-a 0.5 --resistance-ohm 4.5 "
    "--inductance-h 0.0158 --motor-peak-current-a 30 --supply-v 60 --guide-damping-n-s-per-m 500 "
    "--efficiency 1 --full-scale-speed-m-per-s 0.963 --tachometer-v-s-per-rad 0.039 "
    "--velocity-loop-hz 46 --velocity-filter-hz 150 --sensor-full-scale-n 320 "
    "--sensor-stiffness-n-per-m 110100 --sensor-damping-n-s-per-m 16.5 --sensor-bits 8 "
    "--workpiece-stiffness-n-per-m 412700 --workpiece-mass-kg 6.6 "
    "--workpiece-damping-n-s-per-m 8.25",
    "small screw stage, stiff sensor, 16 bits": "--moving-mass-kg 2 --lead-mm-per-rev 2 "
    "--rotor-inertia-kg-m2 2e-6 --torque-constant-n-m-per-a 0.03 --resistance-ohm 2 "
    "--inductance-h 0.0005 --motor-peak-current-a 5 --supply-v 24 --sensor-full-scale-n 50 "
    "--sensor-stiffness-n-per-m 2e5 --sensor-bits 16 --workpiece-stiffness-n-per-m 5e4 "
    "--workpiece-mass-kg 0.1",
    "belt, elastic, 12 bits": "--moving-mass-kg 6 --pulley-radius-mm 15 --rotor-inertia-kg-m2 8e-5 "
    "--torque-constant-n-m-per-a 0.2 --resistance-ohm 1.2 --inductance-h 0.003 "
    "--motor-peak-current-a 12 --supply-v 72 --sensor-full-scale-n 200 "
    "--transmission-stiffness-n-per-m 3e5 --workpiece-stiffness-n-per-m 1e6 --velocity-loop-hz 20",
    "belt, soft pad before the sensor, 8 bits": "--moving-mass-kg 8 --pulley-radius-mm 12 "
    "--rotor-inertia-kg-m2 1.2e-4 --torque-constant-n-m-per-a 0.3 --resistance-ohm 1.5 "
    "--inductance-h 0.004 --motor-peak-current-a 15 --supply-v 72 --sensor-full-scale-n 150 "
    "--sensor-stiffness-n-per-m 2e4 --sensor-bits 8 --workpiece-stiffness-n-per-m 3e5 "
    "--workpiece-mass-kg 4 --velocity-loop-hz 25",
    "direct drive, linear motor, light, 16 bits": "--moving-mass-kg 3 --pulley-radius-mm 10 "
    "--rotor-inertia-kg-m2 1e-6 --torque-constant-n-m-per-a 0.3 --resistance-ohm 3 "
    "--inductance-h 0.01 --motor-peak-current-a 8 --supply-v 150 --efficiency 1 "
    "--full-scale-speed-m-per-s 0.5 --velocity-loop-hz 80 --sensor-full-scale-n 100 "
    "--sensor-stiffness-n-per-m 1e6 --sensor-bits 16 --encoder-counts-per-mm 1000 "
    "--workpiece-stiffness-n-per-m 2e5 --workpiece-mass-kg 1 --workpiece-damping-ratio 0.01",
    "direct drive, heavy tool, 12 bits": "--moving-mass-kg 30 --pulley-radius-mm 10 "
    "--rotor-inertia-kg-m2 1e-6 --torque-constant-n-m-per-a 0.8 --resistance-ohm 2 "
    "--inductance-h 0.015 --motor-peak-current-a 20 --supply-v 300 --efficiency 1 "
    "--full-scale-speed-m-per-s 0.3 --velocity-loop-hz 50 --sensor-full-scale-n 500 "
    "--encoder-counts-per-mm 1000 --workpiece-stiffness-n-per-m 1e6 --workpiece-mass-kg 10 "
    "--workpiece-damping-ratio 0.01",
    "gantry, heavy, screw with play removed, 12 bits": "--moving-mass-kg 400 --lead-mm-per-rev 20 "
    "--rotor-inertia-kg-m2 0.004 --torque-constant-n-m-per-a 1.2 --resistance-ohm 0.6 "
    "--inductance-h 0.006 --motor-peak-current-a 60 --supply-v 560 --sensor-full-scale-n 5000 "
    "--sensor-stiffness-n-per-m 1e7 --transmission-stiffness-n-per-m 8e7 --velocity-loop-hz 25 "
    "--workpiece-stiffness-n-per-m 5e6 --workpiece-mass-kg 40 --workpiece-damping-ratio 0.01",
    "soft workpiece, foam, 12 bits": "--moving-mass-kg 10 --lead-mm-per-rev 10 "
    "--sensor-full-scale-n 200 --workpiece-stiffness-n-per-m 5e3 --workpiece-mass-kg 0.5 "
    "--workpiece-damping-ratio 0.2",
    "grinder, lightly damped casting, 12 bits": "--moving-mass-kg 25 --lead-mm-per-rev 5 "
    "--rotor-inertia-kg-m2 1e-4 --sensor-full-scale-n 500 --sensor-stiffness-n-per-m 2e6 "
    "--workpiece-stiffness-n-per-m 3e6 --workpiece-mass-kg 30 --workpiece-damping-ratio 0.005",
    "noisy sensor, dry seals, 8 bits": "--moving-mass-kg 12 --lead-mm-per-rev 10 "
    "--guide-coulomb-n 5 --sensor-noise-n 0.5 --sensor-bits 8 --workpiece-stiffness-n-per-m 8e5 "
    "--workpiece-mass-kg 8 --workpiece-damping-ratio 0.01",
    "rigid workpiece, defaults": "",
}
