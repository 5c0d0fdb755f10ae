#include "tests/world/simulator.h"
#include <opencv2/opencv.hpp>
using namespace cairn;
int main(int c,char**v){ // out cols scale scenario "k=v,k=v" seconds...
  SimulatorOptions o; std::string opt=v[5]; std::stringstream ss(opt); std::string kv; while(std::getline(ss,kv,',')){ auto e=kv.find('='); if(e==std::string::npos) continue; auto r=o.set_option(kv.substr(0,e),kv.substr(e+1)); if(!r){puts(r.error().message.c_str());return 1;} }
  auto s=Simulator::make(v[4],o); if(!s){puts(s.error().message.c_str());return 1;}
  int cols=atoi(v[2]); double sc=atof(v[3]); std::vector<cv::Mat> m; double tot=0;
  for(int i=6;i<c;i++){ int idx=int(atof(v[i])*30); auto t0=clock(); auto f=s->frame(idx); tot+=double(clock()-t0)/CLOCKS_PER_SEC*1e3; cv::Mat a(f.image.height(),f.image.width(),CV_8UC1,(void*)f.image.row(0),f.image.stride()); cv::Mat b; cv::resize(a,b,{},sc,sc,cv::INTER_AREA); m.push_back(b.clone());
    auto w=s->view(idx); printf("%s:",v[i]); for(auto&p:w.places) printf(" %s %.2f",s->places()[p.place].name.c_str(),p.share); puts(""); }
  printf("ms/frame %.2f, frames %d\n",tot/(c-6),s->frame_count());
  int rows=(m.size()+cols-1)/cols; cv::Mat out(rows*m[0].rows,cols*m[0].cols,CV_8UC1,cv::Scalar(0)); for(size_t i=0;i<m.size();i++) m[i].copyTo(out(cv::Rect((i%cols)*m[0].cols,(i/cols)*m[0].rows,m[0].cols,m[0].rows))); cv::imwrite(v[1],out);}
