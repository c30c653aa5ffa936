; wall plan of paper B (Robotics 2024, 13(5), 78), sections 5.2.2 and 5.2.3
; 1200 mm by 300 mm, 1 layer(s) of 10 mm, 125 mm/s; infill: none
; made by robot_energy_papers.wall
G21 ; mm
G90 ; absolute
G17 ; arcs, if any, are horizontal
G0 X0 Y0 Z0
; layer 1
G1 X1200 Y0 F7500
G1 X1200 Y300 F7500
G1 X0 Y300 F7500
G1 X0 Y0 F7500
M2
