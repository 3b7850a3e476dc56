// A quarter of a plate of 100 x 50 x 2 mm with a hole of 10 mm in its middle: d/W = 0.2. In m.
// gmsh -3 -format msh41 plate.geo
a = 5e-3;   // radius of the hole
b = 25e-3;  // half the width
l = 50e-3;  // half the length
t = 1e-3;   // half the thickness
c = a * Sqrt(0.5);
Point(1) = {a, 0, 0};  Point(2) = {c, c, 0};  Point(3) = {0, a, 0};  Point(9) = {0, 0, 0};
Point(4) = {b, 0, 0};  Point(5) = {b, b, 0};  Point(6) = {0, b, 0};
Point(7) = {l, 0, 0};  Point(8) = {l, b, 0};
Circle(1) = {1, 9, 2};  Circle(2) = {2, 9, 3};
Line(3) = {1, 4};  Line(4) = {2, 5};  Line(5) = {3, 6};
Line(6) = {4, 5};  Line(7) = {5, 6};
Line(8) = {4, 7};  Line(9) = {7, 8};  Line(10) = {5, 8};
Curve Loop(1) = {1, 4, -6, -3};   Plane Surface(1) = {1};
Curve Loop(2) = {2, 5, -7, -4};   Plane Surface(2) = {2};
Curve Loop(3) = {6, 10, -9, -8};  Plane Surface(3) = {3};
Transfinite Curve {1, 2, 6, 7, 9} = 13;
Transfinite Curve {3, 4, 5} = 19 Using Progression 1.18;
Transfinite Curve {8, 10} = 11;
Transfinite Surface {1, 2, 3};
Recombine Surface {1, 2, 3};
Extrude {0, 0, t} { Surface {1, 2, 3}; Layers {1}; Recombine; }
e = 1e-6;
Physical Volume("plate") = Volume{:};
Physical Surface("middle-x") = Surface In BoundingBox{-e, -e, -e, e, b + e, t + e};
Physical Surface("middle-y") = Surface In BoundingBox{-e, -e, -e, l + e, e, t + e};
Physical Surface("middle-z") = Surface In BoundingBox{-e, -e, -e, l + e, b + e, e};
Physical Surface("end") = Surface In BoundingBox{l - e, -e, -e, l + e, b + e, t + e};
